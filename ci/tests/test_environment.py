"""ci/environment.py and ci/ros_env.bash: prerequisites, a sourced ROS, a shell in the environment."""

import shutil
import sys
from pathlib import Path

import environment
import pytest
from checkout import of_a_user, run, succeed


@pytest.fixture
def refusal(monkeypatch, tmp_path):
    """Return a function that makes an environment; it returns the line that refuses it."""

    def refused(name: str = 'venv') -> str:
        monkeypatch.setattr(sys, 'argv', ['environment.py', str(tmp_path / name), 'kilted'])
        with pytest.raises(SystemExit) as ended:
            environment.main()
        (line,) = str(ended.value).splitlines()
        return line

    return refused


@pytest.mark.parametrize(
    ('without', 'package'),
    [('c++', 'build-essential'), ('ensurepip', 'python3-venv'), ('Python.h', 'python3-dev')],
)
def test_a_missing_prerequisite_is_named_with_its_package(refusal, monkeypatch, tmp_path, without, package):
    monkeypatch.delenv('CXX', raising=False)
    for module, name in ((shutil, 'which'), (environment.importlib.util, 'find_spec')):
        find = getattr(module, name)
        monkeypatch.setattr(module, name, lambda each, find=find: None if each == without else find(each))
    if without == 'Python.h':
        monkeypatch.setattr(environment.sysconfig, 'get_path', lambda _name: str(tmp_path))
    assert refusal().endswith(f'is missing: sudo apt install {package}')


def test_an_old_python_is_refused(refusal, monkeypatch):
    monkeypatch.setattr(sys, 'version_info', (3, 9))
    assert 'Python 3.10' in refusal()


def test_a_path_with_a_space_is_refused(refusal):
    assert 'green house' in refusal('green house')


def test_a_folder_of_the_user_is_never_removed(refusal, tmp_path):
    precious = tmp_path / 'venv/precious'
    precious.parent.mkdir()
    precious.touch()
    assert 'VENV=' in refusal()
    assert precious.exists()


def test_without_a_network_the_last_line_asks_for_it(tmp_path):
    dead = dict.fromkeys(('HTTPS_PROXY', 'HTTP_PROXY', 'ALL_PROXY'), 'http://127.0.0.1:9')
    empty = {
        'UV_CACHE_DIR': str(tmp_path / 'uv'),
        'PIP_CACHE_DIR': str(tmp_path / 'pip'),
        'UV_HTTP_RETRIES': '0',
    }
    pip = {'PIP_RETRIES': '0', 'PIP_CONFIG_FILE': '/dev/null', 'PIP_FIND_LINKS': '', 'UV_FIND_LINKS': ''}
    result = run(
        sys.executable,
        'ci/environment.py',
        tmp_path / 'venv',
        'kilted',
        env=of_a_user(**dead, **empty, **pip),
    )
    assert result.returncode == 1
    assert 'network' in result.stderr.splitlines()[-1]
    assert not (tmp_path / 'venv/local_setup.bash').exists()


def test_the_cmake_repair_leaves_other_paths_and_the_cache_alone(tmp_path):
    export = tmp_path / 'share/some_msgs/cmake/export.cmake'
    export.parent.mkdir(parents=True)
    export.write_text(
        '"/opt/python/cp311-cp311/include/python3.11;'
        '/opt/python/cp311-cp311/lib/python3.11/site-packages/numpy/_core/include;/opt/python/else;/usr/include"'
    )
    numpy = tmp_path / 'lib/python3.11/site-packages/numpy/core/include'  # of NumPy 1
    numpy.mkdir(parents=True)
    cached = tmp_path / 'cached.cmake'  # uv links a package into each environment
    cached.hardlink_to(export)
    before = cached.read_text()
    environment.repair_cmake(tmp_path)
    assert cached.read_text() == before
    include, numpy_include, other, system = export.read_text().strip('"').split(';')
    assert Path(include, 'Python.h').exists()
    assert Path(numpy_include) == numpy
    assert (other, system) == ('/opt/python/else', '/usr/include')


@pytest.mark.heavy
def test_a_sourced_ros_is_found_used_and_only_completed(tmp_path):
    """A second prefix, set up like a sourced setup.bash, replaces the wheels."""
    prefix = Path(sys.prefix)
    (tmp_path / 'bin').mkdir()
    (tmp_path / 'bin/ros2').write_text('#!/bin/sh\n')  # its presence marks a sourced ROS
    (tmp_path / 'bin/ros2').chmod(0o755)
    sourced = of_a_user(
        ROS_DISTRO='testros',
        AMENT_PREFIX_PATH=str(prefix),
        CMAKE_PREFIX_PATH=str(prefix),
        PYTHONPATH=environment.sysconfig.get_path('purelib'),
        PATH=f'{tmp_path / "bin"}:{prefix / "bin"}:/usr/bin:/bin',
        VENV=str(tmp_path / 'venv'),
    )
    sourced.pop('VIRTUAL_ENV')
    result = run('make', 'smoke', f'PYTHON={sys._base_executable}', env=sourced)
    assert result.returncode == 0, result.stderr
    assert result.stdout.splitlines()[-1] == '29/29 tags read'
    installed = {path.name for path in (tmp_path / 'venv').glob('lib/python*/site-packages/*')}
    assert installed
    assert not [name for name in installed if name.startswith(('rclpy', 'ros_', 'fastdds', 'rosidl'))]


@pytest.mark.parametrize('trees', [('monorepo', 'monorepo'), ('monorepo', 'lupin_greenhouse_ros')])
def test_a_strict_shell_enters_twice_and_has_each_folder_once(trees):
    first, second = (f'TREE={tree}; source ci/ros_env.bash' for tree in trees)
    script = f'set -euo pipefail; {first}; {second}; echo "$PATH:$PYTHONPATH"; type -P read_tag'
    folders, read_tag = succeed('bash', '-c', script, env=of_a_user()).splitlines()
    own = [each for each in folders.split(':') if each.startswith(sys.prefix)]
    assert own
    assert len(own) == len(set(own))
    assert f'/workspace/{trees[1]}/' in read_tag
    if len(set(trees)) == 2:
        assert f'/workspace/{trees[0]}/' not in folders


def test_a_shell_without_a_build_names_the_command(tmp_path):
    result = run('bash', '-c', 'source ci/ros_env.bash', env=of_a_user(VENV=str(tmp_path)))
    assert 'make build' in result.stderr
