"""
Publish the mirror into a fresh repository and use it as another course team does.

mirror_publish.py publishes the last commit. Then the marked bash blocks of the published documents (BLOCK)
run word for word: the first block of the README as on Ubuntu 22.04, the block of doc/install.md as on Ubuntu
24.04 among the packages of another team, and the block of doc/tests.md after each of them. Shell functions
replace what only Ubuntu has: `source /opt/ros/...` enters the wheels of this environment, `sudo apt install`
installs nothing, and `ros2` runs the executables that colcon has installed. git clones the fresh repository
from the mirror's address. vcs imports the .repos file of the README.
"""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree

import domain_coordinator
import generate
from generate import ROOT, RefusedError, git
from mirror_publish import MIRROR, PACKAGES, READY, publish

BRIDGE = 'lupin_greenhouse_bridge'
BLOCK = re.compile(r'<!-- followed by make mirror-publish-check -->\n```bash\n(.*?)```', re.DOTALL)
PAGES = ('README.md', f'{BRIDGE}/doc/install.md', f'{BRIDGE}/doc/tests.md')
TIMEOUT_SECONDS = 900
UBUNTU = """
trap 'kill $(jobs -p) 2>/dev/null || true; wait' EXIT
sudo() { [ "$1 $2" = 'apt install' ]; }
source() {
    case $1 in
        /opt/ros/*/setup.bash) builtin source "$ROS_SETUP" ;;
        *) builtin source "$1" ;;
    esac
}
ros2() {
    case $1 in
        launch) set -- run "$2" bridge_node ;;
    esac
    local executable="${AMENT_PREFIX_PATH%%:*}/../$2/lib/$2/$3"
    shift 3
    "$executable" "$@"
}
"""
STOP_THE_BRIDGE = "kill -INT -- -$!; wait $! || { echo 'the bridge ended with an error' >&2; exit 1; }"
OTHER_PACKAGE = {
    'package.xml': """<package format="3"><name>other_team</name><version>0.0.1</version>
<description>x</description><maintainer email="a@example.org">a</maintainer><license>MIT</license>
<depend>lupin_greenhouse_msgs</depend><export><build_type>cmake</build_type></export></package>
""",
    'CMakeLists.txt': 'cmake_minimum_required(VERSION 3.16)\nproject(other_team NONE)\n',
}


class CheckFailedError(Exception):
    """A failure that another team would see."""


def run(script: str, log: Path, environment: dict[str, str], folder: Path) -> str:
    """Run a bash script, its output into the log; return the output, raise CheckFailedError on failure."""
    with log.open('w') as output:
        result = subprocess.run(
            ['bash', '-eo', 'pipefail', '-c', script],
            cwd=folder, env=environment, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT,
            timeout=TIMEOUT_SECONDS, check=False,
        )  # fmt: skip
    printed = log.read_text(errors='replace')
    if result.returncode:
        raise CheckFailedError(f'{printed[-6000:]}\nexit code {result.returncode} of:\n{script}')
    return printed


def scripts(pages: list[str], other_package: Path) -> dict[str, str]:
    """Return the script of each workspace, from the texts of PAGES; raises CheckFailedError."""
    blocks = [BLOCK.search(page) for page in pages]
    for name, block in zip(PAGES, blocks, strict=True):
        if not block:
            raise CheckFailedError(
                f'{name}: no bash block is marked with: followed by make mirror-publish-check'
            )
    first, install, test = (block[1] for block in blocks if block)
    cloning = [line for line in first.splitlines() if line.startswith(('mkdir ', 'git clone '))]
    if len(cloning) != 2:
        raise CheckFailedError('the first block of the README does not make a workspace and clone into it')
    among_others = [*cloning, f'cp -r {other_package} src', install, test]
    return {
        'alone, as on Ubuntu 22.04': '\n'.join(['set -m', first, STOP_THE_BRIDGE, test]),
        'among others, as on Ubuntu 24.04': '\n'.join(among_others),
    }


def write_ros_setup(folder: Path) -> Path:
    """Write what /opt/ros/DISTRO/setup.bash would do, for the wheels of this environment."""
    (site_packages,) = Path(sys.prefix).glob('lib/python3*/site-packages')
    script = folder / 'setup.bash'
    script.write_text(
        f'source {sys.prefix}/local_setup.bash\n'
        f'export PYTHONPATH={site_packages} PATH="$PATH:{sys.prefix}/bin"\n'
        f'export LD_LIBRARY_PATH={os.environ["LD_LIBRARY_PATH"]}\n'  # set for this process by the wheels
    )
    return script


def follow(script: str, home: Path, environment: dict[str, str]) -> str:
    """Run a script of a workspace with an empty home folder; return how much it built and tested."""
    # This environment replaces Ubuntu's Python.
    subprocess.run([sys.executable, '-m', 'venv', home / 'usr'], check=True)
    environment = environment | {
        key: value for key, value in os.environ.items() if key.startswith(('PIP_', 'LANG', 'LC_'))
    }
    with domain_coordinator.domain_id() as domain_id:
        environment |= {
            'HOME': str(home),
            'PATH': f'{home}/usr/bin:/usr/local/bin:/usr/bin:/bin',
            'ROS_DISTRO': 'DISTRO',
            'ROS_LOG_DIR': str(home / 'log'),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            'ROS_DOMAIN_ID': str(domain_id),
        }
        installed = f'test -x install/{BRIDGE}/lib/{BRIDGE}/bridge_node'
        printed = run(f'{UBUNTU}set -x\n{script}\n{installed}', home / 'printed.log', environment, home)
    built = re.search(r'^Summary: (\d+) packages finished', printed, re.MULTILINE)
    tested = re.search(r'^Summary: (\d+) tests, 0 errors, 0 failures', printed, re.MULTILINE)
    # test_launch needs launch, which has no wheel.
    written = {path.stem for path in home.glob(f'*/src/{MIRROR}/{BRIDGE}/test/test_*.py')} - {'test_launch'}
    if not built or not tested or modules_that_ran(home) != written:
        raise CheckFailedError(f'not every test ran:\n{printed[-3000:]}')
    return f'{built[1]} packages built, {tested[1]} tests passed'


def modules_that_ran(home: Path) -> set[str]:
    """Return the names of the test modules that `colcon test` ran in the workspace of a home folder."""
    (results,) = home.glob(f'*/build/{BRIDGE}/pytest.xml')
    cases = ElementTree.parse(results).getroot().iter('testcase')  # noqa: S314 - our own
    return {case.get('classname', '').split('.')[-1] for case in cases}


def check_clones(folder: Path, readme: str, address: str, environment: dict[str, str]) -> None:
    """Check which packages colcon sees after each way to get the mirror; raises CheckFailedError."""
    folder.mkdir()
    (folder / 'my.repos').write_text(readme.partition('```yaml\n')[2].partition('```')[0])
    main = f'git clone --quiet --branch main {address} src/{MIRROR}'
    colcon = f'{sys.executable} -m colcon --log-base /dev/null list --names-only --base-paths src'
    monorepo = {path.parent.name for path in ROOT.glob('monorepo/*/package.xml')}
    for name, script, expected in (
        ('vcs import', 'vcs import src < ../my.repos', set(PACKAGES)),
        ('git clone', f'git clone --quiet {address} src/{MIRROR}', set(PACKAGES)),
        ('git clone of main', main, set()),
        ('git clone of main beside the monorepo', f'{main}; cp -r {ROOT}/monorepo src', monorepo),
    ):
        workspace = folder / name.replace(' ', '_')
        (workspace / 'src').mkdir(parents=True)
        run(script, folder / 'clone.log', {**os.environ, **environment}, workspace)
        seen = set(run(colcon, folder / 'list.log', dict(os.environ), workspace).split())
        if seen != expected:
            raise CheckFailedError(f'after {name}, colcon sees {sorted(seen)}, not {sorted(expected)}')
        print(f'after {name}, colcon sees {len(seen)} packages')


def check(folder: Path) -> None:
    """Publish, build, test and clone in a folder; raises CheckFailedError, RefusedError, TimeoutExpired."""
    repository, other_package = folder / 'published.git', folder / 'other_team'
    print('publishing to a local repository', flush=True)
    # A host makes the first branch that it gets the default branch.
    git(ROOT, 'init', '--quiet', '--bare', f'--initial-branch={Path(READY).name}', str(repository))
    publish(ROOT, str(repository), '', is_dry_run=False)
    address = generate.load_table(ROOT)['trees']['mirror']['address']
    environment = {
        'ROS_SETUP': str(write_ros_setup(folder)),
        'GIT_CONFIG_COUNT': '1',
        'GIT_CONFIG_KEY_0': f'url.{repository}.insteadOf',
        'GIT_CONFIG_VALUE_0': address,
    }
    pages = [git(repository, 'show', f'main:{path}') for path in PAGES]
    other_package.mkdir()
    for name, text in OTHER_PACKAGE.items():
        (other_package / name).write_text(text)
    for number, (layout, script) in enumerate(scripts(pages, other_package).items()):
        print(f'{layout}: building, and running the tests (some minutes)', flush=True)
        home = folder / f'home{number}'
        home.mkdir()
        print(f'{layout}: {follow(script, home, environment)}', flush=True)
    check_clones(folder / 'clones', pages[0], address, environment)


def main() -> int:
    """Run the whole check; return the exit code."""
    try:
        with tempfile.TemporaryDirectory(prefix='publish-check-') as folder:
            check(Path(folder))
    except (CheckFailedError, RefusedError, subprocess.TimeoutExpired) as error:
        print(f'publish check failed: {error}', file=sys.stderr)
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
