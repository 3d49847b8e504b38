"""
Publish the mirror into a fresh repository and use it as another course team does.

mirror_publish.py publishes the last commit. Then the marked bash blocks of the published documents run word
for word in two workspaces: as on Ubuntu 22.04, the first block of the README; and as on Ubuntu 24.04, the
first block of doc/install.md, after vcs has imported the .repos example of the README. The second block of
doc/install.md, which runs the tests, follows in both. git clones the fresh repository from the mirror's
address. Shell functions replace what only Ubuntu has: `source /opt/ros/...` enters the wheels of this
environment, `sudo apt install` installs nothing, and `ros2` runs the executables that colcon has installed.
"""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import domain_coordinator
import generate
from generate import ROOT, RefusedError, git
from mirror_publish import READY, publish

BLOCK = re.compile(r'<!-- followed by make mirror-publish-check -->\n```bash\n(.*?)```', re.DOTALL)
PAGES, BLOCKS = ('README.md', 'lupin_greenhouse_bridge/doc/install.md'), 3
TIMEOUT_SECONDS = 900
UBUNTU = """
set -eo pipefail
trap 'kill $(jobs -p) 2>/dev/null || true; wait' EXIT
sudo() { [ "$1 $2" = 'apt install' ]; }
source() {
    case $1 in
        /opt/ros/*/setup.bash)
            builtin source "$ROS_WHEELS/local_setup.bash"
            export LD_LIBRARY_PATH=$ROS_LIBRARIES PYTHONPATH=$(echo "$ROS_WHEELS"/lib/python3*/site-packages)
            ;;
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


def scripts(pages: list[str]) -> dict[str, str]:
    """Return the script of each workspace, from the texts of PAGES; raises RefusedError."""
    blocks = [block for page in pages for block in BLOCK.findall(page)]
    if len(blocks) != BLOCKS:
        raise RefusedError(
            f'{" and ".join(PAGES)}: {len(blocks)} bash blocks are marked with: followed by make'
            f' mirror-publish-check, and not {BLOCKS}'
        )
    first, install, test = blocks
    entry = pages[0].partition('```yaml\n')[2].partition('```')[0]
    importing = f"mkdir -p workspace/src && cd workspace\nvcs import src <<'END'\n{entry}END\n"
    return {
        'by git clone, as on Ubuntu 22.04': f'set -m\n{first}{STOP_THE_BRIDGE}\n{test}',
        'by vcs, as on Ubuntu 24.04': f'{importing}{install}{test}',
    }


def run(script: str, home: Path, environment: dict[str, str]) -> str:
    """Run a script as on Ubuntu in a home folder; return its output. Raises RefusedError."""
    log = home / 'printed.log'
    with log.open('w') as output:
        result = subprocess.run(
            ['timeout', '--kill-after=10', str(TIMEOUT_SECONDS), 'bash', '-xc', UBUNTU + script],
            cwd=home, env=environment, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT,
            check=False,
        )  # fmt: skip
    printed = log.read_text(errors='replace')
    if result.returncode:
        raise RefusedError(f'{printed[-6000:]}\nexit code {result.returncode} of:\n{script}')
    return printed


def follow(script: str, home: Path, environment: dict[str, str]) -> str:
    """Run a script of a workspace; return how much it built and tested. Raises RefusedError."""
    # This environment replaces Ubuntu's Python.
    subprocess.run([sys.executable, '-m', 'venv', home / 'usr'], check=True)
    kept = {key: value for key, value in os.environ.items() if key.startswith(('PIP_', 'LANG', 'LC_'))}
    with domain_coordinator.domain_id() as domain_id:
        of_home = {
            'HOME': str(home),
            'PATH': f'{home}/usr/bin:/usr/local/bin:/usr/bin:/bin:{sys.prefix}/bin',
            'ROS_WHEELS': sys.prefix,
            'ROS_LIBRARIES': os.environ['LD_LIBRARY_PATH'],  # set for this process by the wheels
            'ROS_DISTRO': 'DISTRO',
            'ROS_LOG_DIR': str(home / 'log'),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            'ROS_DOMAIN_ID': str(domain_id),
        }
        printed = run(script, home, kept | environment | of_home)
    built = re.search(r'^Summary: 2 packages finished', printed, re.MULTILINE)
    tested = re.search(r'^Summary: [1-9]\d* tests, 0 errors, 0 failures.*', printed, re.MULTILINE)
    if not built or not tested:
        raise RefusedError(f'the workspace was not built or not tested:\n{printed[-3000:]}')
    return tested[0]


def check(folder: Path) -> None:
    """Publish, clone, build and test in a folder; raises RefusedError."""
    repository = folder / 'published.git'
    # A host makes the first branch that it gets the default branch.
    git(ROOT, 'init', '--quiet', '--bare', f'--initial-branch={Path(READY).name}', str(repository))
    publish(ROOT, str(repository), '', is_dry_run=False)
    environment = {
        'GIT_CONFIG_COUNT': '1',
        'GIT_CONFIG_KEY_0': f'url.{repository}.insteadOf',
        'GIT_CONFIG_VALUE_0': generate.load_table(ROOT)['trees']['mirror']['address'],
    }
    pages = [git(repository, 'show', f'{READY}:{path}') for path in PAGES]
    for number, (way, script) in enumerate(scripts(pages).items()):
        print(f'{way}: building, and running the tests (some minutes)', flush=True)
        home = folder / f'home{number}'
        home.mkdir()
        print(f'{way}: {follow(script, home, environment)}', flush=True)


if __name__ == '__main__':
    try:
        with tempfile.TemporaryDirectory(prefix='publish-check-') as folder:
            check(Path(folder))
    except RefusedError as error:
        sys.exit(f'publish check failed: {error}')
