"""
Publish the mirror into a fresh repository and use it as another course team does.

mirror_publish.py publishes the last commit. The commands of the mirror's README then clone, build and test
it: every ```bash block that is not marked `<!-- needs ... -->`. This script fills in two places of the
README: the address of the repository, and the path of ROS (the wheels of this environment, with a setup file
like /opt/ros/DISTRO/setup.bash). It also gives the README's .repos file to vcs.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree

from mirror_publish import MIRROR, PACKAGES, ROOT, PublishError, Repository, publish

HERE = Repository(ROOT)
BRIDGE = 'lupin_greenhouse_bridge'
BASH_BLOCK = re.compile(r'(?P<mark><!-- needs [^>]*-->\n)?```bash\n(?P<commands>.*?)```', re.DOTALL)
TIMEOUT_SECONDS = 900

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


def import_with_vcs(readme: str, repository: Path, folder: Path) -> dict[str, str]:
    """Follow the README's .repos file with vcs; return the packages that colcon then finds."""
    (folder / 'src').mkdir(parents=True)
    repos = readme.partition('```yaml\n')[2].partition('```')[0]
    (folder / 'my.repos').write_text(repos.replace('URL_OF_THIS_REPOSITORY', str(repository)))
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


def readme_commands(readme: str, repository: Path, setup: Path) -> list[str]:
    """Return the README's executable blocks in order, with the two places replaced."""
    blocks = [match['commands'] for match in BASH_BLOCK.finditer(readme) if not match['mark']]
    filled_in = [
        block.replace('URL_OF_THIS_REPOSITORY', str(repository)).replace(
            '/opt/ros/$ROS_DISTRO/setup.bash', str(setup)
        )
        for block in blocks
    ]
    if not any('git clone' in block for block in blocks) or not any(
        'colcon test ' in block for block in blocks
    ):
        raise CheckFailedError('the README of the mirror has no command that clones, or none that tests')
    if 'COLCON_IGNORE' not in blocks[0]:
        raise CheckFailedError('the first command of the README does not deal with COLCON_IGNORE')
    return filled_in


def follow_readme(name: str, folder: Path, blocks: list[str], other: Path | None) -> str:
    """Follow the README with an empty home, and with another package in src/ if one is given."""
    home = folder / name
    home.mkdir()
    environment = {key: value for key, value in os.environ.items() if key.startswith(('PIP_', 'LANG', 'LC_'))}
    python = Path(getattr(sys, '_base_executable', sys.executable)).parent
    environment |= {
        'HOME': str(home),
        'PATH': f'{python}:/usr/local/bin:/usr/bin:/bin',
        'ROS_LOG_DIR': str(home / 'log'),
    }
    first, *rest = blocks
    add_other = f'cp -r {other} src/other_team' if other else ':'
    check_install = 'test -x install/lupin_greenhouse_bridge/lib/lupin_greenhouse_bridge/bridge_node'
    script = '\n'.join(['set -x', first, add_other, *rest, check_install])
    return run(script, folder / f'{name}.log', environment, home)


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
            repository = publish_mirror(folder)
            readme = HERE.git('show', f'HEAD:{MIRROR}/README.md')
            blocks = readme_commands(readme, repository, ros_setup(folder))
            print(f'published {MIRROR}; following {len(blocks)} blocks of its README', flush=True)

            other = folder / 'other_team'
            for path, text in OTHER_PACKAGE.items():
                (other / path).parent.mkdir(parents=True, exist_ok=True)
                (other / path).write_text(text)
            for layout, extra in (('alone', None), ('among_others', other)):
                printed = follow_readme(layout, folder, blocks, extra)
                tested = re.search(r'^Summary: (\d+) tests, 0 errors, 0 failures', printed, re.MULTILINE)
                written = modules_written(ROOT / MIRROR)
                if not tested or modules_that_ran(folder / layout) != written:
                    raise CheckFailedError(f'not every test ran in layout {layout}:\n{printed[-3000:]}')
                built = re.search(r'^Summary: (\d+) packages finished', printed, re.MULTILINE)
                print(f'layout {layout}: {built[1]} packages built, {tested[1]} tests passed', flush=True)

            imported = import_with_vcs(readme, repository, folder / 'imported')
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
