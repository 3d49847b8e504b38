"""The packages build without a warning, both ways that colcon installs."""

import os
import re
import shutil
import sys
import uuid
from pathlib import Path

import pytest
from conftest import ENVIRONMENTS, ROOT, run, succeed

pytestmark = pytest.mark.heavy
BRIDGE = 'lupin_greenhouse_bridge'
MESSAGES = {'monorepo': 'lupin_msgs', 'lupin_greenhouse_ros': 'lupin_greenhouse_msgs'}
CLEAN_ENVIRONMENT = {
    key: value
    for key, value in os.environ.items()
    if key in ('HOME', 'PATH') or key.startswith(('PIP_', 'LANG', 'LC_'))
}


def run_in(tree, script, runner=succeed):
    """Run a bash script in the environment of a tree, its packages included; return what it printed."""
    # Without the libraries of the environment that runs this test.
    environment = CLEAN_ENVIRONMENT | {'TREE': tree, 'VENV': str(ENVIRONMENTS[tree])}
    return runner('bash', '-ec', f'source ci/ros_env.bash && {script}', env=environment)


def link_the_bridge(tree, base, python_path=''):
    """Build the bridge with links over the tree's messages in its own folder; return the output of colcon."""
    folders = f'--build-base {base}/build --install-base {base}/install --paths {tree}/{BRIDGE}'
    colcon = f'python -m colcon --log-base {base}/log build {folders} --symlink-install'
    return run_in(tree, f'export PYTHONPATH="{python_path}:$PYTHONPATH" && {colcon}')


def test_the_bridge_builds_with_links_without_a_warning(tmp_path):
    """In the monorepo; later tests build the mirror's so."""
    printed = link_the_bridge('monorepo', tmp_path)
    assert f'Finished <<< {BRIDGE}' in printed
    assert 'warning' not in printed.lower()
    assert 'stderr' not in printed
    launch_file = f'{BRIDGE}/launch/greenhouse_bridge.launch.py'
    installed = tmp_path / 'install' / BRIDGE / 'share' / launch_file
    assert installed.resolve() == ROOT / 'monorepo' / launch_file


@pytest.fixture
def workspace():
    """Yield the folder of a tree of its own in the environment's workspace."""
    folder = ENVIRONMENTS['monorepo'] / 'workspace' / f'test-{uuid.uuid4().hex[:8]}'
    yield folder
    shutil.rmtree(folder, ignore_errors=True)
    Path(f'{folder}.lock').unlink(missing_ok=True)


def test_a_build_does_only_what_has_changed(tmp_path, workspace):
    packages = [tmp_path / 'one', tmp_path / 'two']
    for package in packages:
        name = package.name
        (package / name).mkdir(parents=True)
        (package / name / 'module.py').write_text('')
        (package / 'setup.py').write_text(
            f"from setuptools import setup\nsetup(name='{name}', version='1.0.0', packages=['{name}'])\n"
        )
        (package / 'package.xml').write_text(
            f'<package format="3"><name>{name}</name><version>1.0.0</version><description>d</description>'
            '<maintainer email="a@example.org">a</maintainer><license>Apache-2.0</license>'
            '<export><build_type>ament_python</build_type></export></package>'
        )
    variables = os.environ | {'TREE': workspace.name, 'VENV': str(ENVIRONMENTS['monorepo'])}

    def built() -> set[str]:
        printed = succeed(sys.executable, 'ci/build.py', *packages, env=variables)
        lines = [line for line in printed.splitlines() if line.startswith('build: ')]
        return set(lines[0].rpartition(': ')[2].split()) if lines else set()

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
    assert run(sys.executable, 'ci/build.py', *packages, env=variables).returncode == 1
    assert not (workspace / 'two.built').exists()  # it is tried again
    result = run(sys.executable, 'ci/build.py', tmp_path / 'three', env=variables)
    assert result.returncode == 1
    assert result.stderr.startswith(f'build: {tmp_path}/three is no package: name a folder ')


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


@pytest.mark.parametrize(
    ('setuptools', 'is_linked'), [('setuptools==59.6.0', True), ('setuptools>=80', False)]
)
def test_symlink_install_works_with_the_setuptools_of_2022_and_of_today(tmp_path, setuptools, is_linked):
    """Up to setuptools 79 colcon links the modules; from 80 on it copies them silently."""
    packages, tree = tmp_path / 'packages', 'lupin_greenhouse_ros'
    run_in(tree, f'python -m pip install --quiet --no-deps --target {packages} "{setuptools}"')
    printed = link_the_bridge(tree, tmp_path, packages)
    assert f'Finished <<< {BRIDGE}' in printed
    installed = tmp_path / 'install' / BRIDGE
    assert bool(list(installed.glob('lib/python3*/site-packages/*.egg-link'))) == is_linked
    read_tag = f'source {tmp_path}/install/local_setup.bash && {installed}/lib/{BRIDGE}/read_tag --help'
    assert 'usage: read_tag' in run_in(tree, read_tag)


CHOICE = '# The Python of an active environment.*?(?=^find_package)'


@pytest.fixture
def configure(tmp_path):
    """
    Return a function that lets CMake configure in a shell with this setup and no active environment.

    By default it configures the choice of a Python alone. The function returns the result and the cache.
    """
    (choice,) = {
        re.search(CHOICE, (ROOT / tree / name / 'CMakeLists.txt').read_text(), re.M | re.S)[0]
        for tree, name in MESSAGES.items()
    }
    (tmp_path / 'CMakeLists.txt').write_text(
        f'cmake_minimum_required(VERSION 3.16)\nproject(x NONE)\n{choice}'
    )

    def configured(setup, folder=tmp_path):
        build = tmp_path / f'build_of_{folder.name}'
        result = run_in(
            'lupin_greenhouse_ros',
            'source ci/ros_env.bash without-overlay && unset VIRTUAL_ENV CONDA_PREFIX'
            f' && {setup} && cmake -S {folder} -B {build} -DBUILD_TESTING=OFF',
            run,
        )
        return result, (build / 'CMakeCache.txt').read_text()

    return configured


def test_the_messages_are_built_for_the_python_of_the_active_environment(configure, tmp_path):
    """Another Python comes first on PATH. The messages of both trees choose in one way."""
    other, tree = tmp_path / 'bin/python3', 'lupin_greenhouse_ros'
    other.parent.mkdir()
    other.write_text('#!/bin/sh\necho another Python >&2\nexit 1\n')
    other.chmod(0o755)
    environment, path = ENVIRONMENTS[tree], f'PATH={other.parent}:$PATH'
    chosen = [
        f'{name}:FILEPATH={environment}/bin/python3\n' for name in ('Python3_EXECUTABLE', 'PYTHON_EXECUTABLE')
    ]
    _, cache = configure(f'export CONDA_PREFIX={environment} {path}')
    assert all(each in cache for each in chosen)
    result, cache = configure(f'export VIRTUAL_ENV={environment} {path}', ROOT / tree / MESSAGES[tree])
    assert result.returncode == 0, result.stderr
    assert all(each in cache for each in chosen)  # PYTHON_EXECUTABLE is Humble's name
    include_dir = re.search(r'^PYTHON_INCLUDE_DIR:PATH=(.*)$', cache, re.MULTILINE)[1]
    assert Path(include_dir, 'Python.h').exists()
    library = re.search(r'^PYTHON_LIBRARY:FILEPATH=(.*)$', cache, re.MULTILINE)
    assert library is None or Path(library[1]).name.startswith('libpython3')
    numpy = re.search(r'^_?Python3_NumPy_INCLUDE_DIR:\w+=(.*)$', cache, re.MULTILINE)[1]
    assert Path(numpy).is_relative_to(environment)


def test_without_an_active_environment_the_choice_of_python_is_aments(configure):
    result, cache = configure('true')
    assert (result.returncode, 'Python of the active environment' in cache) == (0, False)


def test_an_active_environment_without_numpy_is_named(configure, tmp_path):
    succeed(sys.executable, '-m', 'venv', '--without-pip', tmp_path / 'bare')
    result, _ = configure(f'unset PYTHONPATH && export VIRTUAL_ENV={tmp_path}/bare')
    assert result.returncode != 0
    assert f'NumPy is missing in {tmp_path}/bare: install it there' in ' '.join(result.stderr.split())


def test_with_its_patch_the_mirror_serves_a_custom_tag_file(tmp_path):
    """The test of the monorepo's side passes in a clone of the mirror with custom_tag_file.patch."""
    tree = 'lupin_greenhouse_ros'
    shutil.copytree(ROOT / tree / BRIDGE, tmp_path / BRIDGE)
    patch = (ROOT / tree / 'custom_tag_file.patch').read_text(encoding='utf-8')
    succeed('patch', '-p1', input=patch, cwd=tmp_path)
    printed = run_in(
        tree,
        f'export PYTHONPATH={tmp_path}/{BRIDGE}:$PYTHONPATH && python -m pytest -p no:cacheprovider -rA'
        f' -k a_custom_tag_file_is_served {tmp_path}/{BRIDGE}/test/test_start_up.py',
    )
    assert '1 passed' in printed
