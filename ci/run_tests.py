"""
Run the tests of a step: tree, all, heavy, ubuntu-22-04, apriltag or matrix.

    python ci/run_tests.py STEP

VENV is the environment, WORKERS how many tests of a package run at once. For one tree, PACKAGES selects some
of its packages; for the matrix, PYTHONS, DISTROS and SIMULATORS do. Exit code 1: a test failed.
"""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from build import ROOT, Workspace, build, here
from environment import DISTROS, packages_of
from jobs import Job, Tests, run
from within import pip, stand_ins, within

TREES = ('monorepo', 'lupin_greenhouse_ros')
WORKERS = os.environ.get('WORKERS', '2')
AT_ONCE = 3  # tests often wait, so there are more workers than cores
PYTEST = ('python', '-m', 'pytest', '-p', 'no:cacheprovider', '--verbose', '--instafail', '-rs')
# Many times the longest run: a hang must fail. What a run leaves behind ends with it.
BOUNDED = (sys.executable, 'ci/kill_tree.py', 'timeout', '30m')
# The tests of what the mirror has of its own: its messages, one line of the bridge, manifest and documents.
OF_THE_MIRROR = [f'test/test_{name}.py' for name in ('client', 'documents', 'node', 'package', 'start_up')]
OF_TOOLS = ('tools/tests', 'tools/draw/tests')
MEASUREMENTS = 'tools/measure/tests'
OF_RESULTS = 'ci/tests/test_checkout.py'  # reads those of the other tests
APRILTAG_TESTS = (
    'lupin_tag_confirmation/test/test_images.py',
    'lupin_tag_confirmation/test/test_confirmation.py',
    'lupin_simulation/test/test_pinhole_camera.py::test_4_cm_tags_are_found_where_the_robot_stands',
)
NOT_IN_22_04 = (
    'opencv-python-headless', 'pytest-cov', 'pytest-repeat', 'pytest-rerunfailures', 'pytest-xdist'
)  # fmt: skip
REQUIREMENTS = ROOT / 'ci/requirements'
OLDEST_SIMULATOR = '1.0.7'
SIMULATORS = f'{OLDEST_SIMULATOR} 1.0.8'
AXE = 'axe-core@4.14.1'


def has_module(python: str, module: str) -> bool:
    """Return whether a Python starts, which the shim of a version manager may not, and imports a module."""
    command = [python, '-c', f'import {module}']
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


def python_of(version: str) -> str | None:
    """Return a Python of a version, such as 3.10, that can make environments."""
    pyenv = Path(os.environ.get('PYENV_ROOT') or Path.home() / '.pyenv')
    found = [f'python{version}', f'/usr/bin/python{version}']
    found += map(str, pyenv.glob(f'versions/{version}.*/bin/python'))
    return next((each for each in found if shutil.which(each) and has_module(each, 'venv')), None)


def make_environment(python: str, venv: Path, distro: str) -> None:
    """Make an environment of another Python; end if it fails."""
    command = [python, 'ci/environment.py', str(venv.absolute()), distro]
    if subprocess.run(command, cwd=ROOT, check=False).returncode:
        sys.exit(1)


def use_simulator(venv: Path, version: str) -> None:
    """Install a release of the simulator, if the environment has another one."""
    if not list(packages_of(venv).glob(f'mdp_greenhouse-{version}.dist-info')):
        pip(venv, 'install', '--no-deps', f'mdp-greenhouse=={version}')


def mirror_environment(venv: Path) -> Path:
    """
    Make the environment that the mirror is tested in; return its folder.

    With the wheels, it has the other distro and the oldest simulator, which tests two corners of the matrix
    at once.
    """
    if not (venv / 'local_setup.bash').exists():
        return venv
    other = 'jazzy' if os.environ['ROS_DISTRO'] == 'kilted' else 'kilted'
    mirror_venv = Path(f'{venv}-{other}')
    make_environment(sys.executable, mirror_venv, other)
    use_simulator(mirror_venv, OLDEST_SIMULATOR)
    return mirror_venv


def jobs_of_tree(workspace: Workspace, packages: list[Path], modules: Sequence[str] = ()) -> list[Tests]:
    """Build packages; return a job for the tests of each that has some, or for these modules, by colcon."""
    build(workspace, packages)
    jobs = []
    for package in packages:
        if not (package / 'test').is_dir():
            continue
        colcon = workspace.colcon('test', f'log/test/{package.name}', '--paths', *packages)
        colcon += ['--packages-select', package.name, '--return-code-on-test-failure']
        colcon += ['--event-handlers', 'console_direct+', 'console_cohesion-', 'console_stderr-']
        colcon += ['--pytest-args', ' -n', WORKERS, ' --verbose', ' --instafail', ' -rs']  # not colcon's own
        colcon += modules
        command = [*BOUNDED, *within(workspace, *colcon, has_stand_ins=True)]
        log = workspace.folder / f'{package.name}.test.log'
        jobs.append(Tests(f'{workspace.tree}/{package.name}', command, log))
    return jobs


def bridge_of(workspace: Workspace) -> list[Path]:
    """Return the packages of the bridge alone."""
    return workspace.packages('lupin_*msgs') + workspace.packages('lupin_greenhouse_bridge')


def test_tree() -> bool:
    """Run the tests of one tree, or of the packages in PACKAGES."""
    named = [ROOT / name for name in os.environ.get('PACKAGES', '').split()]
    return run(jobs_of_tree(here(), named or here().packages()), AT_ONCE)


def prepared() -> bool:
    """Build both trees and the stand-ins, and check the code meanwhile; return whether all is well."""
    commands = {tree: ['env', f'TREE={tree}', sys.executable, 'ci/build.py'] for tree in TREES}
    commands['stand-ins'] = [sys.executable, 'ci/within.py', '--stand-ins', 'true']
    # Without the variables of `make test`, which lint does not take.
    commands['lint'] = ['env', 'MAKEFLAGS=--no-print-directory', 'make', 'lint', 'generate-check', 'drift']
    logs = here().venv / 'workspace'
    jobs = [Job(name, command, logs / f'{name}.log') for name, command in commands.items()]
    return run(jobs, at_once=len(jobs))


def pytest_job(name: str, *pytest: str, above: tuple[Workspace, ...] = ()) -> Tests:
    """Return a job for tests of ci/ or tools/."""
    monorepo = Workspace(here().venv, 'monorepo')
    command = monorepo.inside(*PYTEST, *pytest, above=above)
    return Tests(name, [*BOUNDED, *command], monorepo.folder / f'{name}.log')


def test_all() -> bool:
    """
    Check the code, and run the tests of the packages and of what a change of them can break.

    The drift checker proves that the rest of the mirror is the same; test_heavy runs all of its tests.
    """
    monorepo, mirror = (Workspace(here().venv, tree) for tree in TREES)
    if not prepared():
        return False
    jobs = [  # long ones first
        *jobs_of_tree(monorepo, monorepo.packages()),
        pytest_job('ci', '-n', WORKERS, '-m', 'not heavy', 'ci/tests', f'--ignore={OF_RESULTS}'),
        *jobs_of_tree(mirror, mirror.packages(), OF_THE_MIRROR),
    ]
    return run(jobs, AT_ONCE) and run([pytest_job('results', '-m', 'not heavy', OF_RESULTS)])


def test_heavy() -> bool:
    """Run what takes minutes, and the tests of the programs in ci/ and tools/."""
    monorepo, mirror = (Workspace(here().venv, tree) for tree in TREES)
    for each in (monorepo, mirror):
        build(each, each.packages())
    if shutil.which('npm'):  # without it, nothing checks the accessibility of the page
        options = ['--silent', '--no-audit', '--no-fund', '--prefix', str(monorepo.venv / 'axe')]
        subprocess.run(['npm', 'install', *options, AXE], check=False)
    other = mirror._replace(venv=mirror_environment(here().venv))
    os.environ['MIRROR_VENV'] = str(other.venv)
    logs = monorepo.folder / 'heavy'
    itself = (sys.executable, 'ci/run_tests.py')
    both = monorepo._replace(tree='both')  # what compares the two on the wire needs the messages of both
    build(both, mirror.packages('*_msgs'))
    jobs = [
        Job('Ubuntu 22.04', [*itself, 'ubuntu-22-04'], logs / 'ubuntu_22_04.log'),
        pytest_job('measurements', MEASUREMENTS, above=stand_ins(monorepo)),
        pytest_job('tools', '-n', WORKERS, *OF_TOOLS, above=(both,)),
        Job('apriltag', [*itself, 'apriltag'], logs / 'apriltag.log'),
        *jobs_of_tree(other, other.packages()),
    ]
    # Last, because it reads the results of the mirror.
    return run(jobs, AT_ONCE) and run([pytest_job('ci', '-m', 'heavy', 'ci/tests')])


def test_apriltag() -> bool:
    """Run the detector's tests with apt's python3-apriltag and the system's Python, which it is built for."""
    venv, python = Path(f'{here().venv}-apriltag'), '/usr/bin/python3'
    if not has_module(python, 'apriltag'):
        print("test-apriltag: skipped without apt's detector: sudo apt install python3-apriltag python3-venv")
        return True
    if not (venv / 'bin/pytest').exists():
        shutil.rmtree(venv, ignore_errors=True)
        subprocess.run([python, '-m', 'venv', '--system-site-packages', venv], check=True)
        pip(venv, 'install', '--requirement', REQUIREMENTS / 'apriltag.txt')
    imported = ('lupin_greenhouse_bridge', 'lupin_tag_confirmation', 'lupin_simulation')
    os.environ['PYTHONPATH'] = os.pathsep.join(str(ROOT / 'monorepo' / each) for each in imported)  # no ROS
    python_here = str(venv / 'bin/python')
    command = ['env', '--chdir=monorepo', python_here, *PYTEST[1:], '--noconftest', *APRILTAG_TESTS]
    return run([Tests("apt's python3-apriltag", command, venv / 'test.log')])


def make_22_04(python: str, trees: Sequence[Workspace]) -> None:
    """Make the environment with the versions of Ubuntu 22.04, unless these trees have it already."""
    venv, versions = trees[0].venv, REQUIREMENTS / 'ubuntu_22_04.txt'
    mark = venv / 'workspace/versions-22.04'
    if mark.exists() and mark.read_text(encoding='utf-8') == versions.read_text(encoding='utf-8'):
        return
    shutil.rmtree(venv, ignore_errors=True)
    make_environment(python, venv, 'kilted')
    within(trees[0], 'true', has_stand_ins=True)
    for tree in trees:  # first, because messages do not build with the NumPy of 22.04
        build(tree, tree.packages())
    pip(venv, 'uninstall', '--yes', *NOT_IN_22_04)
    pip(venv, 'install', '--requirement', versions)
    shutil.copy(versions, mark)


def test_ubuntu_22_04() -> bool:
    """Run the tests of the mirror's bridge and of the monorepo's nodes with the versions of Ubuntu 22.04."""
    if not (python := python_of('3.10')):
        print('test-22-04: skipped, there is no working Python 3.10: sudo apt install python3.10-venv')
        return True
    mirror, monorepo = (Workspace(Path(f'{here().venv}-22.04'), tree) for tree in reversed(TREES))
    make_22_04(python, (mirror, monorepo))
    for each in (mirror, monorepo):
        build(each, [package for package in each.packages() if not package.name.endswith('_msgs')])
    tested = [(mirror, mirror.packages('lupin_greenhouse_bridge')[0])]
    tested += [(monorepo, each) for each in monorepo.packages() if each not in bridge_of(monorepo)]
    jobs = []
    for tree, package in tested:
        command = within(tree, 'env', f'--chdir={package}', *PYTEST, has_stand_ins=True)
        log = tree.folder / f'{package.name}.log'
        jobs.append(Tests(f'{tree.tree}/{package.name}', [*BOUNDED, *command], log))
    return run(jobs, at_once=2)


def chosen(name: str, default: str, accepted: str, told: str) -> list[str]:
    """Return the words of a variable; end if one of them does not match what is accepted."""
    words = os.environ.get(name, '').split() or default.split()
    for word in words:
        if not re.fullmatch(accepted, word):
            sys.exit(f'matrix: {name}={word}: write {told}')
    return words


def test_matrix() -> bool:
    """Build both trees and test the bridge on each combination; print a row for each."""
    versions = chosen('PYTHONS', '3.10 3.11 3.12 3.13', r'3\.[1-9]\d', 'versions such as 3.12, 3.10 or newer')
    distros = chosen('DISTROS', ' '.join(DISTROS), '|'.join(DISTROS), ' or '.join(DISTROS))
    simulators = chosen(
        'SIMULATORS', SIMULATORS, SIMULATORS.replace(' ', '|'), SIMULATORS.replace(' ', ' or ')
    )
    pythons = {version: python for version in versions if (python := python_of(version))}
    if missing := [version for version in versions if version not in pythons]:
        print(f'matrix: no Python {" or ".join(missing)} here', file=sys.stderr)
    print('| Python | ROS 2 | mdp-greenhouse | monorepo | lupin_greenhouse_ros |\n|---|---|---|---|---|')
    are_good = bool(pythons)
    for version, python in pythons.items():
        for distro in distros:
            venv = ROOT / f'.venv-matrix/{distro}-{version}'
            make_environment(python, venv, distro)
            for simulator in simulators:
                use_simulator(venv, simulator)
                workspaces = [Workspace(venv, tree) for tree in TREES]
                jobs = [job for each in workspaces for job in jobs_of_tree(each, bridge_of(each))]
                are_good &= run(jobs, AT_ONCE)
                cells = [f'**failed**: {job.log}' if job.exit_code else f'{job.done} passed' for job in jobs]
                print('|', ' | '.join([version, distro, simulator, *cells]), '|', flush=True)
    return are_good


if __name__ == '__main__':
    steps = {
        each.__name__.removeprefix('test_').replace('_', '-'): each
        for each in (test_tree, test_all, test_heavy, test_ubuntu_22_04, test_apriltag, test_matrix)
    }
    if sys.argv[1:] not in [[name] for name in steps]:
        sys.exit(f'run_tests: name one step: {", ".join(steps)}')
    if not WORKERS.isdecimal() and WORKERS not in ('auto', 'logical'):
        sys.exit(f'run_tests: WORKERS={WORKERS} is no whole number: write WORKERS=2')
    sys.exit(not steps[sys.argv[1]]())
