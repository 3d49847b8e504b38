"""The packages build without a warning, both ways that colcon installs."""

import os
import re
import shutil
import subprocess
import sys
import uuid
from pathlib import Path

import pytest
from conftest import ENVIRONMENTS

ROOT = Path(__file__).resolve().parents[2]
BRIDGE = 'lupin_greenhouse_bridge'
CLEAN_ENVIRONMENT = {
    key: value
    for key, value in os.environ.items()
    if key in ('HOME', 'PATH') or key.startswith(('PIP_', 'LANG', 'LC_'))
}


def colcon_build_of_the_bridge(tree, base, *arguments, python_path=''):
    """Build the bridge over the tree's messages in its own folder; return the output of colcon."""
    script = (
        'source ci/ros_env.bash && unset PYTHONDONTWRITEBYTECODE'
        ' && export PYTHONPATH="$EXTRA_PYTHONPATH:$PYTHONPATH" && exec python -m colcon'
        ' --log-base "$0/log" build --build-base "$0/build" --install-base "$0/install" "$@"'
    )
    result = subprocess.run(
        ['bash', '-c', script, str(base), '--paths', f'{tree}/lupin_greenhouse_bridge', *arguments],
        cwd=ROOT,
        env={**os.environ, 'TREE': tree, 'VENV': str(ENVIRONMENTS[tree]), 'EXTRA_PYTHONPATH': python_path},
        capture_output=True,
        text=True,
        check=True,
    )
    return result.stdout + result.stderr


@pytest.mark.parametrize('tree', ENVIRONMENTS)
@pytest.mark.parametrize('is_symlinked', [False, True], ids=['copied', 'symlinked'])
def test_the_bridge_builds_without_a_warning(tmp_path, tree, is_symlinked):
    arguments = ['--symlink-install'] if is_symlinked else []
    printed = colcon_build_of_the_bridge(tree, tmp_path, *arguments)
    assert 'Finished <<< lupin_greenhouse_bridge' in printed
    assert 'warning' not in printed.lower()
    assert 'stderr' not in printed
    share = tmp_path / 'install/lupin_greenhouse_bridge/share/lupin_greenhouse_bridge'
    launch_file = share / 'launch/greenhouse_bridge.launch.py'
    assert launch_file.exists()
    source = ROOT / tree / 'lupin_greenhouse_bridge/launch/greenhouse_bridge.launch.py'
    assert (launch_file.resolve() == source) == is_symlinked


@pytest.mark.parametrize('tree', ENVIRONMENTS)
def test_every_package_of_the_tree_was_built_without_a_warning(tree):
    """The output of the last build of each package by `make build`."""
    logs = ENVIRONMENTS[tree] / 'workspace' / tree / 'log'
    for package in sorted(Path(ROOT, tree).glob('lupin_*')):
        last = max(logs.glob(f'build_*/{package.name}'), key=lambda folder: folder.stat().st_mtime)
        assert (last / 'stderr.log').read_text() == ''
        assert 'warning' not in (last / 'stdout_stderr.log').read_text().lower()


@pytest.fixture
def workspace():
    """Yield the folder of a tree of its own in the environment's workspace."""
    folder = ENVIRONMENTS['monorepo'] / 'workspace' / f'test-{uuid.uuid4().hex[:8]}'
    yield folder
    shutil.rmtree(folder, ignore_errors=True)
    Path(f'{folder}.lock').unlink(missing_ok=True)


def make_package(folder: Path) -> None:
    """Write a Python package with one module."""
    name = folder.name
    (folder / name).mkdir(parents=True)
    (folder / name / 'module.py').write_text('')
    (folder / 'setup.py').write_text(
        f"from setuptools import setup\nsetup(name='{name}', version='1.0.0', packages=['{name}'],"
        " data_files=[('share/ament_index/resource_index/packages', ['marker']),"
        f" ('share/{name}', ['package.xml'])])\n"
    )
    (folder / 'marker').write_text('')
    (folder / 'package.xml').write_text(
        f'<package format="3"><name>{name}</name><version>1.0.0</version><description>d</description>'
        '<maintainer email="a@example.org">a</maintainer><license>Apache-2.0</license>'
        '<export><build_type>ament_python</build_type></export></package>'
    )


def test_a_build_does_only_what_has_changed(tmp_path, workspace):
    packages = [tmp_path / 'one', tmp_path / 'two']
    for package in packages:
        make_package(package)
    environment = {
        **os.environ,
        'TREE': workspace.name,
        'VENV': str(ENVIRONMENTS['monorepo']),
    }

    def built() -> set[str]:
        result = subprocess.run(
            [sys.executable, ROOT / 'ci/build.py', *packages],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        lines = [line for line in result.stderr.splitlines() if line.startswith('build: ')]
        return set(lines[0].split()[1:]) if lines else set()

    def modules(name) -> set[str]:
        (installed,) = workspace.glob(f'install/{name}/lib/python3*/site-packages/{name}')
        return {path.name for path in installed.glob('*.py')}

    assert built() == {'one', 'two'}
    assert built() == set()
    (packages[0] / 'one/module.py').rename(packages[0] / 'one/renamed.py')
    assert built() == {'one'}
    assert (modules('one'), modules('two')) == ({'renamed.py'}, {'module.py'})
    assert built() == set()
    (packages[1] / 'setup.py').write_text('raise SystemExit(1)')
    for _ in range(2):  # what failed is tried again
        with pytest.raises(subprocess.CalledProcessError):
            built()


@pytest.mark.heavy
def test_without_a_switch_the_messages_are_built_for_cpp_too(tmp_path):
    """As colcon does by hand; `make build` leaves C++ out."""
    tree, name = 'lupin_greenhouse_ros', 'lupin_greenhouse_msgs'
    run_in(
        tree,
        f'source ci/ros_env.bash without-overlay && python -m colcon --log-base {tmp_path}/log build'
        f' --paths {tree}/{name} --build-base {tmp_path}/build --install-base {tmp_path}/install',
    )
    library = f'{name}/lib/lib{name}__rosidl_typesupport_cpp.so'
    assert (tmp_path / 'install' / library).exists()
    assert (tmp_path / f'install/{name}/include/{name}/{name}/srv/get_tag_reading.hpp').exists()
    assert not (ENVIRONMENTS[tree] / 'workspace' / tree / 'install' / library).exists()


@pytest.mark.heavy
@pytest.mark.parametrize(
    ('setuptools', 'is_linked'),
    [('setuptools==59.6.0', True), ('setuptools>=80', False)],
    ids=['22.04', 'now'],
)
def test_symlink_install_works_with_the_setuptools_of_2022_and_of_today(tmp_path, setuptools, is_linked):
    """Up to setuptools 79 colcon links the modules; from 80 on it copies them silently."""
    packages, tree = tmp_path / 'packages', 'lupin_greenhouse_ros'
    run_in(tree, f'python -m pip install --quiet --no-deps --target {packages} "{setuptools}"')
    printed = colcon_build_of_the_bridge(tree, tmp_path, '--symlink-install', python_path=str(packages))
    assert 'Finished <<< lupin_greenhouse_bridge' in printed
    installed = tmp_path / 'install/lupin_greenhouse_bridge'
    assert bool(list(installed.glob('lib/python3*/site-packages/*.egg-link'))) == is_linked
    result = run_in(
        tree, f'source {tmp_path}/install/local_setup.bash && {installed}/lib/{BRIDGE}/read_tag --help'
    )
    assert 'usage: read_tag' in result.stdout


def run_in(tree, script, *, check=True):
    """Run a bash script in the environment of a tree, its packages included."""
    result = subprocess.run(
        ['bash', '-ec', f'source ci/ros_env.bash && {script}'],
        cwd=ROOT,
        # Without the libraries of the environment that runs this test.
        env={**CLEAN_ENVIRONMENT, 'TREE': tree, 'VENV': str(ENVIRONMENTS[tree])},
        capture_output=True,
        text=True,
        check=False,
    )
    if check:
        assert result.returncode == 0, result.stdout + result.stderr
    return result


@pytest.mark.parametrize('variable', ['VIRTUAL_ENV', 'CONDA_PREFIX'])
@pytest.mark.parametrize(
    ('tree', 'package'), [('monorepo', 'lupin_msgs'), ('lupin_greenhouse_ros', 'lupin_greenhouse_msgs')]
)
def test_the_messages_are_built_for_the_python_of_the_active_environment(tmp_path, tree, package, variable):
    """Another Python comes first on PATH."""
    decoy = tmp_path / 'bin/python3'
    decoy.parent.mkdir()
    decoy.write_text('#!/bin/sh\necho decoy >&2\nexit 1\n')
    decoy.chmod(0o755)
    environment = ENVIRONMENTS[tree]
    run_in(
        tree,
        f'source ci/ros_env.bash without-overlay && unset VIRTUAL_ENV CONDA_PREFIX'
        f' && export {variable}={environment} PATH={decoy.parent}:$PATH'
        f' && cmake -S {tree}/{package} -B {tmp_path}/build -DBUILD_TESTING=OFF',
    )
    cache = (tmp_path / 'build/CMakeCache.txt').read_text()
    assert f'Python3_EXECUTABLE:FILEPATH={environment}/bin/python3\n' in cache
    assert f'PYTHON_EXECUTABLE:FILEPATH={environment}/bin/python3\n' in cache  # Humble's name
    include_dir = re.search(r'^PYTHON_INCLUDE_DIR:PATH=(.*)$', cache, re.MULTILINE)[1]
    assert Path(include_dir, 'Python.h').exists()
    library = re.search(r'^PYTHON_LIBRARY:FILEPATH=(.*)$', cache, re.MULTILINE)
    assert library is None or Path(library[1]).name.startswith('libpython3')
    numpy = re.search(r'^_?Python3_NumPy_INCLUDE_DIR:\w+=(.*)$', cache, re.MULTILINE)[1]
    assert Path(numpy).is_relative_to(environment)


def test_without_an_active_environment_the_choice_of_python_is_aments(tmp_path):
    run_in(
        'monorepo',
        'source ci/ros_env.bash without-overlay && unset VIRTUAL_ENV CONDA_PREFIX'
        f' && cmake -S monorepo/lupin_msgs -B {tmp_path}/build -DBUILD_TESTING=OFF',
    )
    assert 'Python of the active environment' not in (tmp_path / 'build/CMakeCache.txt').read_text()


def test_an_active_environment_without_numpy_is_named(tmp_path):
    subprocess.run([sys.executable, '-m', 'venv', '--without-pip', tmp_path / 'bare'], check=True)
    result = run_in(
        'monorepo',
        f'source ci/ros_env.bash without-overlay && unset PYTHONPATH && export VIRTUAL_ENV={tmp_path}/bare'
        f' && cmake -S monorepo/lupin_msgs -B {tmp_path}/build -DBUILD_TESTING=OFF',
        check=False,
    )
    assert result.returncode != 0
    assert f'NumPy is missing in {tmp_path}/bare: install it there' in ' '.join(result.stderr.split())


def test_with_its_patch_the_mirror_serves_a_custom_tag_file(tmp_path):
    """The contract tests of the monorepo's side pass in a clone of the mirror with custom_tag_file.patch."""
    tree = 'lupin_greenhouse_ros'
    shutil.copytree(ROOT / tree / BRIDGE, tmp_path / BRIDGE)
    with (ROOT / tree / 'custom_tag_file.patch').open() as file:
        subprocess.run(['patch', '-p1'], stdin=file, cwd=tmp_path, check=True)
    result = run_in(
        tree,
        f'export PYTHONPATH={tmp_path}/{BRIDGE}:$PYTHONPATH && python -m pytest -p no:cacheprovider -rA'
        f' -k "a_custom_tag_file_is_served or with_another_tag_file" {tmp_path}/{BRIDGE}/test',
    )
    assert '2 passed' in result.stdout
