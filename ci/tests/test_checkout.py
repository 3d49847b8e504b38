"""What is committed, how it builds, and what `make` and `colcon test` do with it."""

import os
import re
import shutil
from pathlib import Path

import pytest
from checkout import ROOT, TREES, make, of_a_user, run, succeed

ENTRIES = {'Makefile', 'README.md', 'ci', 'lupin_greenhouse_ros', 'monorepo', 'tools'}
BRIDGE = 'lupin_greenhouse_bridge'
MESSAGES = {'monorepo': 'lupin_msgs', 'lupin_greenhouse_ros': 'lupin_greenhouse_msgs'}


def test_no_other_visible_entry_is_committed():
    listed = succeed('git', 'ls-tree', '--name-only', 'HEAD').splitlines()
    assert {name for name in listed if not name.startswith('.')} == ENTRIES


def test_make_lists_every_target():
    listed = make().stdout
    named = re.findall(r'^([a-z-]+):.*##', (ROOT / 'Makefile').read_text(), re.MULTILINE)
    assert len(named) > 20
    assert [name for name in named if f'\n  {name} ' not in f'\n{listed}'] == []


def test_clean_leaves_what_a_person_may_want_to_keep(tmp_path):
    kept = ['.mission/report.jsonl', '.tags/tags.pdf', '.world/greenhouse.sdf', '.venv/bin/python']
    for each in [*kept, '.venv/workspace/monorepo/built', '.hypothesis/examples']:
        (tmp_path / each).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / each).touch()
    result = make('clean', 'VENV=.venv', cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert {str(each.relative_to(tmp_path)) for each in tmp_path.rglob('*') if each.is_file()} == set(kept)


@pytest.mark.parametrize('words', ['-p debug_seed:=42', 'debug_seed=42', '--print'])
def test_an_argument_of_another_form_is_refused_in_both_environments(words):
    result = make('run', f'ARGS={words}')
    assert result.returncode == 2
    assert f"'{words.split()[0]}'" in result.stderr


@pytest.mark.parametrize('tree', TREES)
def test_every_package_of_the_tree_was_built_without_a_warning(tree):
    logs = Path(os.environ['VIRTUAL_ENV'], 'workspace', tree, 'log')
    for package in sorted(Path(ROOT, tree).glob('lupin_*')):
        last = max(logs.glob(f'build_*/{package.name}'), key=lambda folder: folder.stat().st_mtime)
        assert (last / 'stderr.log').read_text() == ''
        assert 'warning' not in (last / 'stdout_stderr.log').read_text().lower()


def colcon(tree: str, verb: str, base: Path, *arguments: object) -> str:
    """Run colcon as a user does, over what is built; return what it prints."""
    folders = f'--build-base {base}/build --install-base {base}/install'
    words = ' '.join(map(str, arguments))
    script = f'source ci/ros_env.bash && python -m colcon --log-base {base}/log {verb} {folders} {words}'
    return succeed('bash', '-ec', script, env=of_a_user(TREE=tree))


@pytest.mark.heavy
@pytest.mark.parametrize('tree', TREES)
def test_colcon_test_runs_every_test(tree, tmp_path):
    """Without pytest declared in its setup.py, a package's tests are not found, and colcon is green."""
    packages = [path.parent for path in sorted(Path(ROOT, tree).glob('lupin_*/package.xml'))]
    tested = [path for path in packages if (path / 'test').is_dir()]
    paths = ['--paths', *tested]
    colcon(tree, 'build', tmp_path, *paths)
    colcon(tree, 'test', tmp_path, *paths, '--return-code-on-test-failure', '--pytest-args', '" -n"', '3')
    for package in tested:
        collect = f'cd {package} && python -m pytest --collect-only -q -p no:cacheprovider'
        script = f'source {ROOT}/ci/ros_env.bash && {collect}'
        listed = succeed('bash', '-ec', script, env=of_a_user(TREE=tree))
        tests = re.findall(r'^test/.*::', listed, re.MULTILINE)
        results = (tmp_path / 'build' / package.name / 'pytest.xml').read_text(encoding='utf-8')
        assert f' tests="{len(tests)}"' in results
        assert ' failures="0"' in results
        assert ' errors="0"' in results
        assert ' skipped="0"' in results


@pytest.mark.heavy
def test_planning_and_readings_build_and_pass_their_tests_in_a_workspace_with_the_mirror(tmp_path):
    """As in the workspace of another team, which has no lupin_msgs."""
    added = ('lupin_planning', 'lupin_readings')
    for package in (MESSAGES['lupin_greenhouse_ros'], BRIDGE):
        shutil.copytree(ROOT / 'lupin_greenhouse_ros' / package, tmp_path / 'src' / package)
    script = f"""source {ROOT}/ci/ros_env.bash without-overlay && cd {tmp_path}
    source $VIRTUAL_ENV/workspace/ci/stand_ins/install/local_setup.bash
    paths=$(echo {ROOT}/monorepo/{{{','.join(added)}}})
    python -m colcon build --cmake-args -DBUILD_TESTING=OFF -DWITH_CPP=OFF --no-warn-unused-cli
    source install/local_setup.bash
    python -m colcon build --paths $paths
    source install/local_setup.bash
    if python -c 'import lupin_msgs' 2> /dev/null; then exit 1; fi
    python -m colcon test --paths $paths --return-code-on-test-failure --pytest-args " -n" 3"""
    assert succeed('bash', '-ec', script, env=of_a_user()).count('Summary: 2 packages finished') == 3
    for package in added:
        results = (tmp_path / 'build' / package / 'pytest.xml').read_text(encoding='utf-8')
        assert int(re.search(r' tests="(\d+)"', results)[1]) > 50
        assert ' skipped="0"' in results


@pytest.mark.heavy
@pytest.mark.parametrize('tree', TREES)
def test_the_bridge_builds_with_links_without_a_warning(tree, tmp_path):
    printed = colcon(tree, 'build', tmp_path, '--symlink-install', '--paths', f'{tree}/{BRIDGE}')
    assert f'Finished <<< {BRIDGE}' in printed
    assert 'warning' not in printed.lower()
    assert 'stderr' not in printed


@pytest.mark.heavy
def test_by_default_the_messages_are_built_for_cpp_too(tmp_path):
    name = MESSAGES['lupin_greenhouse_ros']
    colcon('lupin_greenhouse_ros', 'build', tmp_path, '--paths', f'lupin_greenhouse_ros/{name}')
    assert (tmp_path / f'install/{name}/lib/lib{name}__rosidl_typesupport_cpp.so').exists()
    assert (tmp_path / f'install/{name}/include/{name}/{name}/srv/get_tag_reading.hpp').exists()


@pytest.fixture
def configure(tmp_path):
    """Return a function that configures the mirror's messages with no active environment but this setup."""

    def configured(setup: str):
        build = tmp_path / 'build'
        source = f'lupin_greenhouse_ros/{MESSAGES["lupin_greenhouse_ros"]}'
        script = (
            'source ci/ros_env.bash without-overlay && unset VIRTUAL_ENV CONDA_PREFIX'
            f' && {setup} && cmake -S {source} -B {build} -DBUILD_TESTING=OFF'
        )
        return run('bash', '-ec', script, env=of_a_user()), build / 'CMakeCache.txt'

    return configured


@pytest.mark.heavy
@pytest.mark.parametrize('name', ['VIRTUAL_ENV', 'CONDA_PREFIX'])
def test_the_messages_are_built_for_the_python_of_the_active_environment(configure, tmp_path, name):
    """Another Python comes first on PATH."""
    other, environment = tmp_path / 'bin/python3', os.environ['VIRTUAL_ENV']
    other.parent.mkdir()
    other.write_text('#!/bin/sh\necho another Python >&2\nexit 1\n')
    other.chmod(0o755)
    result, cache = configure(f'export {name}={environment} PATH={other.parent}:$PATH')
    assert result.returncode == 0, result.stderr
    for variable in ('Python3_EXECUTABLE', 'PYTHON_EXECUTABLE'):  # the latter is Humble's name
        assert f'{variable}:FILEPATH={environment}/bin/python3\n' in cache.read_text()


def test_both_trees_choose_the_python_of_their_messages_in_one_way():
    choices = {
        re.search(
            r'# The Python of an active environment.*?(?=^find_package)', text, re.MULTILINE | re.DOTALL
        )[0]
        for text in ((ROOT / tree / name / 'CMakeLists.txt').read_text() for tree, name in MESSAGES.items())
    }
    assert len(choices) == 1


@pytest.mark.heavy
def test_with_its_patch_the_mirror_serves_a_custom_tag_file(tmp_path):
    """The test of the monorepo's side passes in a clone of the mirror with custom_tag_file.patch."""
    tree = 'lupin_greenhouse_ros'
    shutil.copytree(ROOT / tree / BRIDGE, tmp_path / BRIDGE)
    patch = (ROOT / tree / 'custom_tag_file.patch').read_text(encoding='utf-8')
    succeed('patch', '-p1', input=patch, cwd=tmp_path)
    script = (
        f'source ci/ros_env.bash && export PYTHONPATH={tmp_path}/{BRIDGE}:$PYTHONPATH'
        ' && python -m pytest -p no:cacheprovider -rA -k a_custom_tag_file_is_served'
        f' {tmp_path}/{BRIDGE}/test/test_start_up.py'
    )
    assert '1 passed' in succeed('bash', '-ec', script, env=of_a_user(TREE=tree))
