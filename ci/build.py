"""
Build packages of TREE with colcon into its workspace in the environment, each only if its files have changed.

    python ci/build.py [PACKAGE...]      default: every package of the tree

VENV is the environment (default: .venv), TREE the tree (default: monorepo). The packages are named one by
one, because the mirror's COLCON_IGNORE hides its root. It imports little: every `make run` starts it.
"""

from __future__ import annotations

import ctrl_c  # noqa: F401

# isort: split
import hashlib
import os
import re
import shlex
import shutil
import sys
from pathlib import Path
from typing import NamedTuple

from jobs import Build, Word, end, lack_of_space, locked, run

ROOT = Path(__file__).resolve().parents[1]
NEEDED_MB = 100
SHOWN = re.compile(r'^--- stderr:(?s:.*?)^---$|^.*WARNING.*$|^Summary.*$', re.MULTILINE)


class Workspace(NamedTuple):
    """Where a tree is built: a folder in an environment."""

    venv: Path
    tree: str

    @property
    def folder(self) -> Path:
        """The folder of the tree's build, install and log folders."""
        return self.venv / 'workspace' / self.tree

    def packages(self, pattern: str = 'lupin_*') -> list[Path]:
        """Return the folders of the tree's packages."""
        return sorted(ROOT.glob(f'{self.tree}/{pattern}'))

    def inside(
        self, *command: Word, is_overlaid: bool = True, above: tuple[Workspace, ...] = ()
    ) -> list[str]:
        """Return what runs a command in this environment, with its packages and those of other workspaces."""
        script = f'source {shlex.quote(str(ROOT))}/ci/ros_env.bash'
        script += '' if is_overlaid else ' without-overlay'
        for each in above:
            script += f' && source "$VIRTUAL_ENV/workspace/{each.tree}/install/local_setup.bash"'
        settings = [f'VENV={self.venv}', f'TREE={self.tree}']
        return ['env', *settings, 'bash', '-ec', f'{script} && exec "$@"', 'bash', *map(str, command)]

    def colcon(self, verb: str, log: str, *arguments: Word) -> list[Word]:
        """Return a command of colcon with the folders of this workspace, and its log in one of them."""
        colcon: list[Word] = ['python', '-m', 'colcon', '--log-base', self.folder / log, verb]
        colcon += ['--build-base', self.folder / 'build', '--install-base', self.folder / 'install']
        return [*colcon, *arguments]


def here() -> Workspace:
    """Return the workspace that VENV and TREE select; end if there is no environment."""
    venv = ROOT / os.environ.get('VENV', '.venv')
    if not (venv / '.lupin-environment').exists():
        sys.exit(f'there is no environment {venv}: make env')
    return Workspace(venv, os.environ.get('TREE', 'monorepo'))


def fingerprint(package: Path, venv: Path) -> str:
    """Return a hash of everything that a package is built from."""
    digest = hashlib.sha256(Path(__file__).read_bytes())
    digest.update((venv / '.lupin-environment').read_bytes())
    for folder, folders, names in os.walk(package):
        folders[:] = sorted(name for name in folders if not name.startswith('.'))
        for name in sorted(names):
            path = Path(folder, name)
            if not name.startswith('.') and not name.endswith('.pyc') and not path.is_symlink():
                digest.update(f'\0{path.relative_to(package)}\0'.encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()


def build(workspace: Workspace, packages: list[Path]) -> None:
    """Build what has changed; end the process if that fails."""
    if not packages:
        sys.exit(f'TREE={workspace.tree} is not a tree: set TREE=monorepo or TREE=lupin_greenhouse_ros')
    for package in packages:
        if not (package / 'package.xml').exists():
            sys.exit(f'build: {package} is no package: name a folder such as monorepo/lupin_mission')
    folder = workspace.folder
    folder.mkdir(parents=True, exist_ok=True)
    with locked(f'{folder}.lock', 'build'):  # of two builds at once, the second finds nothing to do
        changed = {}
        for package in packages:
            mark, now = folder / f'{package.name}.built', fingerprint(package, workspace.venv)
            if not mark.exists() or mark.read_text(encoding='utf-8') != now:
                changed[mark] = now
                mark.unlink(missing_ok=True)
                if (package / 'setup.py').exists():  # it would install a deleted or renamed module once more
                    shutil.rmtree(folder / 'build' / package.name, ignore_errors=True)
                    shutil.rmtree(folder / 'install' / package.name, ignore_errors=True)
        if changed:
            run_colcon(workspace, packages, [mark.stem for mark in changed])
        for mark, now in changed.items():
            mark.write_text(now, encoding='utf-8')


def run_colcon(workspace: Workspace, packages: list[Path], names: list[str]) -> None:
    """
    Build the packages of these names.

    Shows warnings and the summary; or everything, and ends the process, if it fails.
    """
    print(f'build: {len(names)} new or changed:', *names, file=sys.stderr)
    folder = workspace.folder
    if problem := lack_of_space(folder, NEEDED_MB):
        sys.exit(f'build: {problem}')
    command = workspace.colcon('build', 'log', '--paths', *packages, '--packages-select', *names)
    # Only Python uses what is built here, so the messages leave out C++, which takes most of the time.
    command += ['--cmake-args', f'-DPython3_EXECUTABLE={workspace.venv}/bin/python']
    command += ['-DBUILD_TESTING=OFF', '-DWITH_CPP=OFF', '--no-warn-unused-cli']
    command += ['--event-handlers', 'console_direct+']
    # colcon's own -l would leave cores unused beside other work.
    os.environ['MAKEFLAGS'] = f'-j{os.cpu_count()}'
    job = Build(workspace.inside(*command, is_overlaid=False), folder / 'build.log', len(names))
    if not run([job]):
        sys.exit(1)
    print('\n'.join(SHOWN.findall(job.output())), file=sys.stderr)


if __name__ == '__main__':
    named = [Path(name).absolute() for name in sys.argv[1:]]
    end(lambda: build(here(), named or here().packages()), 'build')
