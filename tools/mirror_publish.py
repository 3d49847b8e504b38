"""
Publish the mirror: the branches `main` and `ready`, and a release.

    make mirror-publish REMOTE=URL [RELEASE=1.2.0] [ARGS=--dry-run]

`main` is the history of lupin_greenhouse_ros/, split out of the last commit here. `ready` is `main` without
COLCON_IGNORE, so that colcon finds the packages of a clone. A release is a tag with the version of both
packages. No history is rewritten, and either everything is pushed or nothing. The first publication writes
the address of the remote into tools/twins.toml and the mirror's README, to be committed.
Exit code: 0 published, or nothing to do; 1 refused.
"""

import argparse
import re
import sys
from pathlib import Path
from typing import NoReturn

import check_drift
import generate
from generate import ROOT, Parser, RefusedError, git

MIRROR = 'lupin_greenhouse_ros'
PACKAGES = ('lupin_greenhouse_msgs', 'lupin_greenhouse_bridge')
MAIN, READY = 'refs/heads/main', 'refs/heads/ready'


def address_of(remote: str) -> str:
    """Return the address that a reader can clone: by https and without credentials; a folder is unchanged."""
    by_ssh = re.fullmatch(r'(?:ssh://)?git@([^:/]+)(?::\d+/|[:/])(.+)', remote)
    https = f'https://{by_ssh[1]}/{by_ssh[2]}' if by_ssh else re.sub(r'^(https?://)[^/@]*@', r'\1', remote)
    return https.removesuffix('.git')


def mirror_address(here: Path) -> str:
    """Return the address in tools/twins.toml; '' before the first publication."""
    return str(generate.load_table(here)['trees']['mirror']['address'])


def set_address(here: Path, address: str) -> NoReturn:
    """Write the address into tools/twins.toml and the mirror's README, for the maintainer to commit."""
    table = here / 'tools/twins.toml'
    text = table.read_text(encoding='utf-8')
    table.write_text(text.replace('address = ""', f'address = "{address}"'), encoding='utf-8')
    generate.main(['--root', str(here)])
    raise RefusedError(
        f"nothing is published yet: tools/twins.toml and the mirror's README now name {address}."
        ' Commit them, then publish again'
    )


def check_this_checkout(here: Path, remote: str) -> None:
    """Raise RefusedError if the last commit must not be published."""
    if git(here, 'status', '--porcelain'):
        raise RefusedError('there are uncommitted changes: commit or stash them')
    if git(here, 'rev-parse', '--is-shallow-repository') == 'true\n':
        raise RefusedError('this clone has a part of the history only: git fetch --unshallow')
    address = mirror_address(here)
    if address and address_of(address) != address_of(remote):
        raise RefusedError(
            f'the mirror\'s README names {address}, not {remote}: set address = "{address_of(remote)}.git"'
            ' under [trees.mirror] in tools/twins.toml, run make generate, and commit'
        )
    if generate.main(['--check', '--root', str(here)]):
        raise RefusedError('the trees are not what tools/core generates')
    if check_drift.main(['--monorepo', str(here / 'monorepo'), '--mirror', str(here / MIRROR)]):
        raise RefusedError('the trees have drifted apart')


def check_release(here: Path, release: str) -> None:
    """Raise RefusedError if a package has another version, or its changelog begins with another section."""
    for package in PACKAGES:
        folder = here / MIRROR / package
        version = re.search(r'<version>(.*)</version>', (folder / 'package.xml').read_text(encoding='utf-8'))
        if not version or version[1] != release:
            raise RefusedError(f'{package}/package.xml: must have version {release}')
        newest = re.search(
            r'^(.+)\n-+$', (folder / 'CHANGELOG.rst').read_text(encoding='utf-8'), re.MULTILINE
        )
        if not newest or not newest[1].startswith(f'{release} ('):
            raise RefusedError(f'{package}/CHANGELOG.rst: must begin with a section {release} (YYYY-MM-DD)')


def next_ready(here: Path, ready: str, main: str) -> str:
    """Return the commit of `ready` that contains `main`; '' is a `ready` that does not exist yet."""

    def tree_without_ignore(commit: str) -> str:
        entries = git(here, 'ls-tree', commit).splitlines(keepends=True)
        kept = [entry for entry in entries if not entry.endswith('\tCOLCON_IGNORE\n')]
        return git(here, 'mktree', text=''.join(kept)).strip()

    if ready:
        *_, published = git(here, 'rev-list', '--parents', '--max-count=1', ready).split()
        if git(here, 'rev-parse', f'{ready}^{{tree}}').strip() != tree_without_ignore(published):
            raise RefusedError('the branch ready has changes of its own: move them to main by a patch')
        if published == main:
            return ready
    parents = [f'-p{parent}' for parent in (ready, main) if parent]
    message = '-mMerge main, without COLCON_IGNORE\n\nColcon finds the packages of this branch.\n'
    return git(here, 'commit-tree', *parents, message, tree_without_ignore(main)).strip()


def publish(here: Path, remote: str, release: str, *, is_dry_run: bool) -> list[str]:
    """Publish the last commit; return what was pushed. Raises RefusedError."""
    if release:
        check_release(here, release)
    check_this_checkout(here, remote)
    tag = f'refs/tags/{release}'
    listed = git(here, 'ls-remote', remote, MAIN, READY, tag).splitlines()
    if not mirror_address(here) and not is_dry_run:
        set_address(here, f'{address_of(remote)}.git')
    before = dict(line.split('\t')[::-1] for line in listed)
    if before:
        git(here, 'fetch', '--quiet', '--no-tags', remote, *before)
    print(f'mirror-publish: splitting the history of {MIRROR}', file=sys.stderr, flush=True)
    main = git(here, 'subtree', '-q', 'split', f'--prefix={MIRROR}').strip()
    if MAIN in before and git(here, 'rev-list', '--count', before[MAIN], '--not', main) != '0\n':
        raise RefusedError(
            'main on the remote has commits that are not in this repository: import them first:'
            ' make mirror-import PATCH=N.patch'
        )
    after = {MAIN: main, READY: next_ready(here, before.get(READY, ''), main)}
    if release:
        after[tag] = main
        if before.get(tag, main) != main:
            raise RefusedError(
                f'release {release} already exists ({before[tag][:10]}): choose another version'
            )
    moved = {name: new for name, new in after.items() if before.get(name) != new}
    if moved:
        dry_run = ['--dry-run'] if is_dry_run else []
        git(
            here,
            'push',
            '--quiet',
            '--atomic',
            *dry_run,
            remote,
            *(f'{new}:{name}' for name, new in moved.items()),
        )
    word = 'would push' if is_dry_run else 'pushed'
    return [f'{word} {name} {before.get(name, "new")[:10]} -> {new[:10]}' for name, new in moved.items()]


def main(arguments: list[str] | None = None) -> int:
    """Publish to the remote on the command line; return the exit code."""
    parser = Parser('mirror-publish', description=__doc__.splitlines()[1], allow_abbrev=False)
    parser.add_argument('remote', help='URL of the repository to publish to')
    parser.add_argument('--release', default='', metavar='VERSION', help='tag the commit with this version')
    parser.add_argument('--dry-run', action='store_true', help='print what would be pushed, and push nothing')
    parser.add_argument('--root', type=Path, default=ROOT, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    try:
        lines = publish(options.root, options.remote, options.release, is_dry_run=options.dry_run)
    except RefusedError as error:
        print(f'mirror-publish: {error}', file=sys.stderr)
        return 1
    print(*lines or ['nothing to publish'], sep='\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
