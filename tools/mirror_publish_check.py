"""
Publish the mirror into a fresh repository and use it as another course team does.

mirror_publish.py publishes the last commit. Then the marked bash blocks of the published documents (BLOCK)
run word for word: the first block of the README as on Ubuntu 22.04, the block of doc/install.md as on Ubuntu
24.04 among the packages of another team, and the block of doc/tests.md after each of them. Shell functions
replace what only Ubuntu has: `source /opt/ros/...` enters the wheels of this environment, `sudo apt install`
installs nothing, and `ros2` runs the executables that colcon has installed. vcs imports the .repos file of
the README.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree

import domain_coordinator
from mirror_publish import MIRROR, PACKAGES, ROOT, PublishError, Repository, publish

HERE = Repository(ROOT)
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
    'package.xml': '<package format="3"><name>other_team</name><version>0.0.1</version>'
    '<description>x</description><maintainer email="a@example.org">a</maintainer><license>MIT</license>'
    '<exec_depend>lupin_greenhouse_msgs</exec_depend>'
    '<export><build_type>ament_python</build_type></export></package>',
    'setup.py': 'from setuptools import setup\n'
    "setup(name='other_team', version='0.0.1', packages=['other_team'])\n",
    'setup.cfg': '',
    'other_team/__init__.py': '',
}


class CheckFailedError(Exception):
    """A failure that another team would see."""


def run(script: str, log: Path, environment: dict, folder: Path) -> str:
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


def publish_mirror(folder: Path) -> Path:
    """Return a fresh bare repository with the published mirror."""
    repository = folder / 'published.git'
    HERE.git('init', '--quiet', '--bare', '--initial-branch=main', str(repository))
    publish(HERE, str(repository), '', is_dry_run=False)
    return repository


def published_text(repository: Path, path: str) -> str:
    """Return a file of the published main."""
    return Repository(repository).exactly('show', f'main:{path}')


def import_with_vcs(readme: str, folder: Path) -> dict[str, str]:
    """Follow the README's .repos file with vcs; return the packages that colcon then finds."""
    (folder / 'src').mkdir(parents=True)
    (folder / 'my.repos').write_text(readme.partition('```yaml\n')[2].partition('```')[0])
    run('vcs import src < my.repos', folder / 'vcs.log', dict(os.environ), folder)
    return packages_seen(folder)


def ros_setup(folder: Path) -> Path:
    """Write what /opt/ros/DISTRO/setup.bash would do, for the wheels of this environment."""
    prefix = sys.prefix
    site_packages = next(
        path for path in sys.path if path.endswith('site-packages') and path.startswith(prefix)
    )
    script = folder / 'setup.bash'
    script.write_text(
        f'source {prefix}/local_setup.bash\n'
        f'export PYTHONPATH={site_packages} PATH="$PATH:{prefix}/bin"\n'
        f'export LD_LIBRARY_PATH={os.environ["LD_LIBRARY_PATH"]}\n'  # set for this process by the wheels
    )
    return script


def layouts(pages: list[str], other: Path) -> dict[str, str]:
    """Return the script of each layout, from the texts of PAGES; raises CheckFailedError."""
    blocks = [BLOCK.search(page) for page in pages]
    for name, block in zip(PAGES, blocks, strict=True):
        if not block:
            raise CheckFailedError(
                f'{name}: no bash block is marked with: followed by make mirror-publish-check'
            )
    first, install, test = (block[1] for block in blocks)
    lines = first.splitlines()
    cloning = [line for line in lines if line.startswith(('mkdir ', 'git clone '))]
    if len(cloning) != 2:
        raise CheckFailedError('the first block of the README does not make a workspace and clone into it')
    return {
        'alone, as on Ubuntu 22.04': '\n'.join(['set -m', first, STOP_THE_BRIDGE, test]),
        'among others, as on Ubuntu 24.04': '\n'.join(
            [*cloning, f'cp -r {other} src/other_team', install, test]
        ),
    }


def home_of(layout: str, folder: Path) -> Path:
    """Return the home folder of a layout."""
    return folder / layout.partition(',')[0].replace(' ', '_')


def follow(name: str, folder: Path, script: str, setup: Path) -> str:
    """Run a script with an empty home; return what it printed."""
    home = home_of(name, folder)
    home.mkdir()
    subprocess.run(
        [sys.executable, '-m', 'venv', str(home / 'usr')], check=True
    )  # instead of Ubuntu's Python
    environment = {key: value for key, value in os.environ.items() if key.startswith(('PIP_', 'LANG', 'LC_'))}
    environment |= {
        'HOME': str(home),
        'PATH': f'{home}/usr/bin:/usr/local/bin:/usr/bin:/bin',
        'ROS_DISTRO': 'DISTRO',
        'ROS_LOG_DIR': str(home / 'log'),
        'ROS_SETUP': str(setup),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    }
    installed = 'test -x install/lupin_greenhouse_bridge/lib/lupin_greenhouse_bridge/bridge_node'
    with domain_coordinator.domain_id() as domain_id:
        environment['ROS_DOMAIN_ID'] = str(domain_id)
        return run(f'{UBUNTU}set -x\n{script}\n{installed}', home / 'printed.log', environment, home)


def modules_written(repository: Path) -> set[str]:
    """Return the names of the bridge's test modules; test_launch needs launch, which has no wheel."""
    return {path.stem for path in (repository / BRIDGE / 'test').glob('test_*.py')} - {'test_launch'}


def modules_that_ran(home: Path) -> set[str]:
    """Return the names of the test modules that `colcon test` ran in the workspace of a home."""
    (results,) = home.glob(f'*/build/{BRIDGE}/pytest.xml')
    cases = ElementTree.parse(results).getroot().iter('testcase')  # noqa: S314 - our own
    return {case.get('classname').split('.')[-1] for case in cases}


def packages_seen(workspace: Path) -> dict[str, str]:
    """Return name -> folder of each package that colcon finds below a workspace."""
    command = [sys.executable, '-m', 'colcon', '--log-base', '/dev/null', 'list', '--base-paths', 'src']
    result = subprocess.run(command, cwd=workspace, capture_output=True, text=True, check=True)
    rows = [line.split('\t') for line in result.stdout.splitlines()]
    if len({name for name, *_ in rows}) != len(rows):
        raise CheckFailedError(f'colcon finds a package twice:\n{result.stdout}')
    return {name: path for name, path, *_ in rows}


def main() -> int:
    """Run the whole check; print a line per step."""
    with tempfile.TemporaryDirectory(prefix='publish-check-') as name:
        folder = Path(name)
        try:
            print('publishing to a local repository', flush=True)
            repository = publish_mirror(folder)
            other = folder / 'other_team'
            for path, text in OTHER_PACKAGE.items():
                (other / path).parent.mkdir(parents=True, exist_ok=True)
                (other / path).write_text(text)
            pages = [published_text(repository, path) for path in PAGES]
            setup = ros_setup(folder)
            for layout, script in layouts(pages, other).items():
                print(f'{layout}: building, and running the tests (some minutes)', flush=True)
                printed = follow(layout, folder, script, setup)
                tested = re.search(r'^Summary: (\d+) tests, 0 errors, 0 failures', printed, re.MULTILINE)
                written = modules_written(ROOT / MIRROR)
                if not tested or modules_that_ran(home_of(layout, folder)) != written:
                    raise CheckFailedError(f'not every test ran {layout}:\n{printed[-3000:]}')
                built = re.search(r'^Summary: (\d+) packages finished', printed, re.MULTILINE)
                print(f'{layout}: {built[1]} packages built, {tested[1]} tests passed', flush=True)

            imported = import_with_vcs(pages[0], folder / 'imported')
            if set(imported) != set(PACKAGES):
                raise CheckFailedError(f'after vcs import of the branch ready colcon sees {imported}')
            print('after vcs import of the branch ready colcon sees both packages')

            trap = folder / 'trap/src'
            HERE.git('clone', '--quiet', str(repository), str(trap / MIRROR))
            if packages_seen(trap.parent):
                raise CheckFailedError('COLCON_IGNORE does not hide a fresh clone')
            print('a fresh clone is hidden by COLCON_IGNORE')
            shutil.copytree(ROOT / 'monorepo', trap / 'monorepo')
            seen = packages_seen(trap.parent)
            if seen.get(BRIDGE) != f'src/monorepo/{BRIDGE}' or 'lupin_greenhouse_msgs' in seen:
                raise CheckFailedError(f'beside the monorepo colcon sees {seen}')
            print(f'beside the monorepo colcon sees one {BRIDGE}, the one of the monorepo')
        except (CheckFailedError, PublishError, subprocess.TimeoutExpired) as error:
            print(f'publish check failed: {error}', file=sys.stderr)
            return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
