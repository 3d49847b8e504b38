"""What is committed, and that every package was built and its tests are found and ran."""

import os
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from conftest import ENVIRONMENTS, NEED_LAUNCH, ROOT, run, succeed
from run_tests import MEASUREMENTS, OF_RESULTS, OF_THE_MIRROR, OF_TOOLS

ENTRIES = {'Makefile', 'README.md', 'ci', 'lupin_greenhouse_ros', 'monorepo', 'tools'}
PACKAGES = [('monorepo', path.parent.name) for path in sorted(Path('monorepo').glob('*/test'))]
MIRROR = pytest.param('lupin_greenhouse_ros', 'lupin_greenhouse_bridge', marks=pytest.mark.heavy)
HIDE = 'import sys\nsys.modules |= dict.fromkeys({modules!r})\n'  # None: it is not there


def test_no_other_visible_entry_is_committed():
    listed = succeed('git', 'ls-tree', '--name-only', 'HEAD').splitlines()
    assert {name for name in listed if not name.startswith('.')} == ENTRIES


def test_a_clone_that_converts_line_ends_has_none_to_convert(tmp_path):
    """With core.autocrlf=true, which Git for Windows sets, bash would not read a script of its clone."""
    succeed('git', 'clone', '--quiet', '--config', 'core.autocrlf=true', ROOT, tmp_path / 'clone')
    listed = succeed('git', 'ls-files', '--eol', cwd=tmp_path / 'clone')
    assert 'w/lf' in listed
    assert [line for line in listed.splitlines() if 'w/crlf' in line or 'w/mixed' in line] == []


def test_each_folder_of_tests_outside_of_the_packages_is_run():
    written = succeed('git', 'ls-files', '*/tests/test_*.py').splitlines()
    run_by_make = {'ci/tests', MEASUREMENTS, *OF_TOOLS}
    assert {str(Path(each).parent) for each in written} == run_by_make
    assert OF_RESULTS in written


@pytest.mark.heavy
@pytest.mark.parametrize(
    ('package', 'modules'),
    [
        ('lupin_greenhouse_bridge', ['matplotlib', 'apriltag_msgs']),
        ('lupin_mission', ['nav2_msgs']),
        ('lupin_simulation', ['nav2_msgs']),
    ],
)
def test_every_test_module_is_collected_without_optional_modules(tmp_path, package, modules):
    """launch_testing imports each test module in the same way."""
    (tmp_path / 'sitecustomize.py').write_text(HIDE.format(modules=modules), encoding='utf-8')
    path = {'PYTHONPATH': os.pathsep.join([str(tmp_path), os.environ.get('PYTHONPATH', '')])}
    for module in modules:
        assert run(sys.executable, '-c', f'import {module}', env=os.environ | path).returncode == 1
    collect = (sys.executable, '-m', 'pytest', '--collect-only', '-q', '-p', 'no:cacheprovider', 'test')
    folder = ROOT / 'monorepo' / package
    listed = succeed(*collect, cwd=folder, env=os.environ | path)
    collected = {Path(line.partition('::')[0]).stem for line in listed.splitlines() if '::' in line}
    written = {path.stem for path in folder.glob('test/test_*.py')}
    assert collected | NEED_LAUNCH == written | NEED_LAUNCH


@pytest.mark.parametrize('tree', ENVIRONMENTS)
def test_every_package_of_the_tree_was_built_without_a_warning(tree):
    """The output of the last build of each package by `make build`, which copies."""
    logs = ENVIRONMENTS[tree] / 'workspace' / tree / 'log'
    for package in sorted(Path(ROOT, tree).glob('lupin_*')):
        last = max(logs.glob(f'build_*/{package.name}'), key=lambda folder: folder.stat().st_mtime)
        assert (last / 'stderr.log').read_text() == ''
        assert 'warning' not in (last / 'stdout_stderr.log').read_text().lower()


def results_of(tree, package='lupin_greenhouse_bridge'):
    results = ENVIRONMENTS[tree] / 'workspace' / tree / 'build' / package / 'pytest.xml'
    cases = ElementTree.parse(results).getroot().iter('testcase')
    return {(case.get('classname'), case.get('name')): case.find('skipped') is not None for case in cases}


@pytest.mark.parametrize(('tree', 'package'), [*PACKAGES, MIRROR])
def test_colcon_ran_every_test_and_skipped_none(tree, package):
    results = results_of(tree, package)
    modules = {part for name, _ in results for part in name.split('.') if part.startswith('test_')}
    written = {path.stem for path in Path(tree, package, 'test').glob('test_*.py')}
    assert modules - NEED_LAUNCH == written - NEED_LAUNCH
    assert [test for test, is_skipped in results.items() if is_skipped] == []


def test_the_mirror_ran_every_test_of_what_it_has_of_its_own():
    monorepo, mirror = map(results_of, ENVIRONMENTS)
    modules = {module for module, _ in mirror}
    assert {module.rpartition('.')[2] for module in modules} >= {Path(each).stem for each in OF_THE_MIRROR}
    assert mirror == {test: is_skipped for test, is_skipped in monorepo.items() if test[0] in modules}
