"""ci/environment.py: prerequisites, a sourced ROS, and when it makes an environment again."""

import os
import re
import shutil
import signal
import sys
from pathlib import Path
from xml.etree import ElementTree

import environment
import pytest
from conftest import ROOT, make, of_a_user, run, start, succeed

pytestmark = pytest.mark.heavy
CI = ROOT / 'ci'


@pytest.fixture(autouse=True)
def without_ros_and_uv(monkeypatch):
    """Let no sourced ROS be found in this process, and no uv on PATH."""
    find = shutil.which
    monkeypatch.setattr(shutil, 'which', lambda name: None if name == 'uv' else find(name))
    monkeypatch.setattr(environment, 'sourced_ros', lambda: None)


@pytest.fixture
def commands(monkeypatch):
    """Record the commands instead of running pip and venv."""
    ran = []

    def record(_what, command, _log):
        ran.append(command)
        if 'venv' in command:
            (Path(command[-1]) / 'bin').mkdir()
            (Path(command[-1]) / 'bin/python').touch()
            (Path(command[-1]) / 'lib/python3.11/site-packages').mkdir(parents=True)

    monkeypatch.setattr(environment, 'run', record)
    return ran


def test_a_complete_environment_is_left_alone_and_another_distro_makes_it_again(commands, tmp_path):
    for distro in ('kilted', 'jazzy'):
        environment.complete(tmp_path / 'venv', distro)
        assert [Path(command[-1]).name for command in commands] == ['venv', 'uv', f'{distro}.txt']
        assert f'ROS_DISTRO={distro}' in (tmp_path / 'venv/local_setup.bash').read_text()
        commands.clear()
        environment.complete(tmp_path / 'venv', distro)
        assert commands == []


def test_an_installed_uv_is_used(commands, tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, 'which', lambda name: f'/tools/{name}')
    environment.complete(tmp_path / 'venv', 'kilted')
    assert commands[1][:3] == ['/tools/uv', 'pip', 'install']


@pytest.fixture
def one_pin(tmp_path, monkeypatch):
    """Reduce the list of packages to uv and one other; return the other as 'name==version'."""
    pins = (CI / 'requirements/kilted.txt').read_text().splitlines()
    two = [pin.partition('  #')[0] for pin in pins if pin.startswith(('packaging==', 'uv=='))]
    (tmp_path / 'kilted.txt').write_text('\n'.join(two))
    monkeypatch.setattr(environment, 'REQUIREMENTS', tmp_path)
    return two[0].strip()


@pytest.mark.parametrize('installer', ['uv', 'pip'])
def test_uv_installs_the_pins_and_pip_does_where_uv_cannot(one_pin, tmp_path, monkeypatch, capsys, installer):
    if installer == 'pip':
        monkeypatch.setenv('UV_OFFLINE', '1')
        monkeypatch.setenv('UV_CACHE_DIR', str(tmp_path / 'empty'))
    environment.complete(tmp_path / 'venv', 'kilted')
    assert ('uv cannot install here, so pip does' in capsys.readouterr().err) == (installer == 'pip')
    assert one_pin in succeed(tmp_path / 'venv/bin/python', '-m', 'pip', 'freeze').splitlines()
    (installed_by,) = tmp_path.glob('venv/lib/python3*/site-packages/packaging-*.dist-info/INSTALLER')
    assert installed_by.read_text().strip() == installer


def test_an_interrupted_making_is_recognised_and_made_again(commands, tmp_path, monkeypatch):
    record = environment.run

    def interrupted(what, command, log):
        record(what, command, log)
        if 'pip' in command:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(environment, 'run', interrupted)
        with pytest.raises(KeyboardInterrupt):
            environment.complete(tmp_path / 'venv', 'kilted')
    half_made = tmp_path / 'venv/half-made'
    half_made.touch()
    commands.clear()
    environment.complete(tmp_path / 'venv', 'kilted')
    assert len(commands) == 3
    assert not half_made.exists()


def test_a_failed_step_is_told_and_not_taken_for_done(tmp_path, monkeypatch, capsys):
    broken = tmp_path / 'python3'
    broken.write_text('#!/bin/sh\necho no space left >&2\nexit 1\n')
    broken.chmod(0o755)
    monkeypatch.setattr(sys, 'executable', str(broken))
    for _ in range(2):
        with pytest.raises(SystemExit, match=f'^environment: making .* stopped at: {broken} -m venv '):
            environment.complete(tmp_path / 'venv', 'kilted')
        assert capsys.readouterr().err.endswith('\nno space left\n')


@pytest.fixture
def refusal(commands, tmp_path):
    """Return a function that tries to make the environment, and returns the line that refuses it."""

    def refused(name='venv'):
        with pytest.raises(SystemExit) as told:
            environment.complete(tmp_path / name, 'kilted')
        assert commands == []
        return str(told.value).splitlines()[-1]

    return refused


def test_a_folder_that_is_not_ours_is_never_removed(refusal, tmp_path):
    precious = tmp_path / 'venv/precious'
    precious.parent.mkdir()
    precious.touch()
    assert 'was not made by this project' in refusal()
    assert precious.exists()


@pytest.mark.parametrize('character', [*' \'"$#%,=;:&()*?[]{}<>|`\\', '\u00a0', '\udcfc'])
def test_a_folder_in_which_nothing_can_be_built_is_refused(refusal, character):
    assert f'fail with {character!r} in a path: move the clone' in refusal(f'a{character}b')


def test_a_full_disk_is_named(refusal, tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, 'disk_usage', lambda _folder: shutil._ntuple_diskusage(1, 1, 9e6))
    assert refusal() == f'environment: {tmp_path} has 9 MB free: make room for 1200 MB'


@pytest.mark.parametrize(
    ('without', 'missing'),
    [
        ('cc', 'the compiler cc (CC) is missing: sudo apt install build-essential'),
        ('c++', 'the compiler c++ (CXX) is missing: sudo apt install build-essential'),
        ('venv', f'the venv module of {sys.executable} is missing: sudo apt install python3-venv'),
        ('ensurepip', f'the venv module of {sys.executable} is missing: sudo apt install python3-venv'),
        ('Python.h', f'Python.h of {sys.executable} is missing: sudo apt install python3-dev'),
        ('cmake', 'cmake is missing: sudo apt install cmake'),
        (
            'x86_64',
            'a sourced ROS 2 (there are no wheels for aarch64) is missing:'
            ' sudo apt install ros-jazzy-ros-base, source /opt/ros/jazzy/setup.bash',
        ),
    ],
)
def test_each_missing_prerequisite_is_named_with_its_package(
    refusal, tmp_path, monkeypatch, without, missing
):
    monkeypatch.delenv('CC', raising=False)
    monkeypatch.setenv('CXX', ' ')
    monkeypatch.setattr(environment, 'sourced_ros', lambda: 'humble' if without == 'cmake' else None)
    for module, name in ((shutil, 'which'), (environment.importlib.util, 'find_spec')):
        find = getattr(module, name)
        monkeypatch.setattr(module, name, lambda each, find=find: None if each == without else find(each))
    if without == 'x86_64':
        monkeypatch.setattr(environment.platform, 'machine', lambda: 'aarch64')
    if without == 'Python.h':
        monkeypatch.setattr(environment.sysconfig, 'get_path', lambda _name: str(tmp_path))
    assert refusal() == f'environment: {missing}'


@pytest.mark.parametrize('own', ['', '/my/profiles.xml'])
def test_nodes_of_the_wheels_announce_themselves_often_unless_told_otherwise(own):
    names = ['FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE']
    name = names.pop(os.environ['ROS_DISTRO'] == 'jazzy')
    bare = {key: value for key, value in os.environ.items() if key != name}
    bare[names[0]] = str(CI / 'fast_dds.xml')  # of the other distro, which this one warns of
    environ = bare | ({name: own} if own else {})
    shown = succeed('bash', '-c', f'source ci/ros_env.bash && echo ${name} ${names[0]}', env=environ)
    assert shown.strip() == (own or str(CI / 'fast_dds.xml'))
    period = ElementTree.parse(CI / 'fast_dds.xml').find('.//{*}leaseAnnouncement/{*}sec')
    assert 0 < int(period.text) < 3  # Fast DDS's default


def test_the_cmake_repair_leaves_other_paths_alone(tmp_path):
    export = tmp_path / 'share/some_msgs/cmake/export.cmake'
    export.parent.mkdir(parents=True)
    export.write_text(
        '"/opt/python/cp311-cp311/include/python3.11;'
        '/opt/python/cp311-cp311/lib/python3.11/site-packages/numpy/_core/include;/opt/python/else;/usr/include"'
    )
    packages = tmp_path / 'lib/python3.11/site-packages'
    packages.mkdir(parents=True)
    cached = tmp_path / 'cached.cmake'  # uv links a package into each environment
    cached.hardlink_to(export)
    before = cached.read_text()
    environment.repair_cmake(tmp_path)
    assert cached.read_text() == before
    include, numpy_include, other, system = export.read_text().strip('"').split(';')
    assert Path(include, 'Python.h').exists()
    assert Path(numpy_include) == packages / 'numpy/_core/include'
    assert (other, system) == ('/opt/python/else', '/usr/include')


@pytest.mark.parametrize('distro', ['kilted', 'jazzy'])
def test_the_pins_are_whole_and_name_no_registry(distro):
    for line in (CI / f'requirements/{distro}.txt').read_text().splitlines():
        assert re.fullmatch(r'\s*#.*|\S+==[^\s/]+( .*)?', line)


def test_pre_commit_comes_with_the_environment():
    succeed(sys.executable, '-m', 'pre_commit', 'validate-config', ROOT / '.pre-commit-config.yaml')


def test_a_sourced_ros_is_found_used_and_only_completed(tmp_path):
    """A second prefix, set up like a sourced setup.bash, replaces the wheels."""
    prefix = Path(sys.prefix)
    (tmp_path / 'bin').mkdir()
    (tmp_path / 'bin/ros2').write_text('#!/bin/sh\n')  # its presence marks a sourced ROS
    (tmp_path / 'bin/ros2').chmod(0o755)
    site_packages = environment.sysconfig.get_path('purelib')
    sourced = of_a_user(
        ROS_DISTRO='testros',
        AMENT_PREFIX_PATH=str(prefix),
        CMAKE_PREFIX_PATH=str(prefix),
        PYTHONPATH=site_packages,
        PATH=f'{tmp_path / "bin"}:{prefix / "bin"}:{os.environ["PATH"]}',
        VENV=str(tmp_path / 'venv'),
    )
    sourced.pop('VIRTUAL_ENV')
    base_python = getattr(sys, '_base_executable', sys.executable)
    result = run('make', 'smoke', f'PYTHON={base_python}', env=sourced)
    assert 'from the sourced ROS 2 testros' in result.stderr
    assert result.returncode == 0, result.stderr
    assert result.stdout.splitlines()[-1] == '29/29 tags read'
    installed = {path.name for path in (tmp_path / 'venv').glob('lib/python*/site-packages/*')}
    assert not [name for name in installed if name.startswith(('rclpy', 'ros_', 'fastdds', 'rosidl'))]


@pytest.mark.parametrize('given', ['.venv-x', '/x/Büro/.venv', '/x/a+b@c~d!e^f-g.h_1'])
def test_a_folder_for_the_environment_is_taken_as_it_is(given):
    result = make('help', '--print-data-base', f'VENV={given}')
    (venv,) = re.findall('^VENV := (.*)$', result.stdout, re.MULTILINE)
    assert venv == str(given if given[0] == '/' else ROOT / given)
    assert environment.unusable_characters(venv) == ''


def test_without_a_network_one_line_names_it(tmp_path):
    dead = dict.fromkeys(('HTTPS_PROXY', 'HTTP_PROXY', 'ALL_PROXY'), 'http://127.0.0.1:9')
    empty = {'UV_CACHE_DIR': str(tmp_path / 'uv'), 'PIP_CACHE_DIR': str(tmp_path / 'pip')}
    pip = {'PIP_RETRIES': '1', 'PIP_CONFIG_FILE': os.devnull, 'PIP_FIND_LINKS': '', 'UV_FIND_LINKS': ''}
    command = (sys.executable, 'ci/environment.py', tmp_path / 'venv', 'kilted')
    result = run(*command, env=os.environ | dead | empty | pip)
    assert result.returncode == 1
    assert 'cannot be downloaded: check the network (' in result.stderr.splitlines()[-1]
    assert 'HTTPS_PROXY=http://127.0.0.1:9' in result.stderr.splitlines()[-1]
    assert 'ResolutionImpossible' not in result.stderr


def test_ctrl_c_ends_it_in_one_line(tmp_path):
    process = start(sys.executable, 'ci/environment.py', str(tmp_path / 'venv'), 'kilted')
    while not (tmp_path / 'venv/install.log').exists():
        assert process.poll() is None
    os.killpg(process.pid, signal.SIGINT)
    *_, last = process.communicate()[0].splitlines()
    assert (process.returncode, last) == (130, 'environment: interrupted')
