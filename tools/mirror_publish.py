"""
Publish the mirror: the branches `main` and `ready`, and a release.

    make mirror-publish REMOTE=URL [RELEASE=1.2.0] [ARGS=--dry-run]

`main` is the history of lupin_greenhouse_ros/, split out of the last commit here. `ready` is `main` without
COLCON_IGNORE, so that colcon finds the packages of a clone. A release is a tag with the version of both
packages. The program rewrites no history. It pushes `ready` first to an empty remote, where the first branch
becomes the default branch; apart from that, it pushes either everything or nothing.
Exit code: 0 published, or nothing to do; 1 refused.
"""

import argparse
import re
import sys
from pathlib import Path

import check_drift
import generate
from generate import ROOT, Parser, RefusedError, git

MIRROR = 'lupin_greenhouse_ros'
PACKAGES = ('lupin_greenhouse_msgs', 'lupin_greenhouse_bridge')
MAIN, READY = 'refs/heads/main', 'refs/heads/ready'
CHANGELOG_SECTION = re.compile(r'^(.+)\n-+$', re.MULTILINE)


def address_of(remote: str) -> str:
    """Return the address that a reader can clone: by https, without credentials; a folder is unchanged."""
    by_ssh = re.fullmatch(r'(?:ssh://)?git@([^:/]+)(?::\d+/|[:/])(.+)', remote)
    return f'https://{by_ssh[1]}/{by_ssh[2]}' if by_ssh else re.sub(r'^(https?://)[^/@]*@', r'\1', remote)


def check_this_checkout(here: Path) -> None:
    """Raise RefusedError if the last commit must not be published."""
    if git(here, 'status', '--porcelain'):
        raise RefusedError('there are uncommitted changes: commit or stash them')
    if git(here, 'rev-parse', '--is-shallow-repository') == 'true\n':
        raise RefusedError('this clone has a part of the history only: git fetch --unshallow')
    if generate.main(['--check', '--root', str(here)]):
        raise RefusedError('the trees are not what tools/core generates')
    if check_drift.main(['--monorepo', str(here / 'monorepo'), '--mirror', str(here / MIRROR)]):
        raise RefusedError('the trees have drifted apart')


def check_release(here: Path, release: str) -> None:
    """Raise RefusedError if a package has another version, or entries of a later one."""
    for package in PACKAGES:
        manifest = git(here, 'show', f'HEAD:{MIRROR}/{package}/package.xml')
        if (version := manifest.partition('<version>')[2].partition('<')[0]) != release:
            raise RefusedError(f'release {release}: {package}/package.xml has version {version}')
        newest = CHANGELOG_SECTION.findall(git(here, 'show', f'HEAD:{MIRROR}/{package}/CHANGELOG.rst'))[0]
        if not newest.startswith(f'{release} ('):
            raise RefusedError(
                f'release {release}: {package}/CHANGELOG.rst begins with {newest}: give this section'
                ' the version and the date'
            )


def tree_without_ignore(here: Path, commit: str) -> str:
    """Return the tree of a commit without COLCON_IGNORE."""
    entries = git(here, 'ls-tree', commit).splitlines(keepends=True)
    kept = [entry for entry in entries if not entry.endswith('\tCOLCON_IGNORE\n')]
    return git(here, 'mktree', text=''.join(kept)).strip()


def is_ancestor(here: Path, old: str, new: str) -> bool:
    """Return whether a commit is in the history of another one, or is that commit."""
    return git(here, 'rev-list', '--count', old, '--not', new) == '0\n'


def next_ready(here: Path, ready: str, main: str, committer: list[str]) -> str:
    """Return the commit of `ready` that contains `main`; '' is a `ready` that does not exist yet."""
    if ready:
        tree, *parents = git(here, 'show', '-s', '--format=%T %P', ready).split()
        if [tree] != [tree_without_ignore(here, published) for published in parents[-1:]]:
            raise RefusedError('the branch ready has changes of its own: move them to main by a patch')
        if is_ancestor(here, main, ready):
            return ready
    options = [f'-p{parent}' for parent in (ready, main) if parent]
    options.append('-mMerge main, without COLCON_IGNORE\n\nColcon finds the packages of this branch.\n')
    return git(here, *committer, 'commit-tree', *options, tree_without_ignore(here, main)).strip()


def publish(here: Path, remote: str, release: str, *, is_dry_run: bool) -> list[str]:
    """Publish the last commit; return what was pushed. Raises RefusedError."""
    if release:
        check_release(here, release)
    try:
        before = dict(line.split('\t')[::-1] for line in git(here, 'ls-remote', remote).splitlines())
    except RefusedError as error:
        told = str(error).splitlines()[0]
        raise RefusedError(f'REMOTE={remote} cannot be read: {told}') from error
    check_this_checkout(here)
    print(f'mirror-publish: taking the history of {MIRROR} (about 20 s)', file=sys.stderr, flush=True)
    main = git(here, 'subtree', '-q', 'split', f'--prefix={MIRROR}').strip()
    # A build machine may have no git identity.
    name, email = git(here, 'show', '-s', '--format=%cn%n%ce').splitlines()
    committer = ['-c', f'user.name={name}', '-c', f'user.email={email}']
    branches = [name for name in (MAIN, READY) if name in before]
    if branches:
        git(here, 'fetch', '--quiet', '--no-tags', '--no-write-fetch-head', remote, *branches)
    if MAIN in before and not is_ancestor(here, before[MAIN], main):
        raise RefusedError(
            'main of the remote has commits that are not published from here: bring them in as patches'
            ' (make mirror-import PATCH=...); to drop them, remove them from the remote'
        )
    after = {READY: next_ready(here, before.get(READY, ''), main, committer), MAIN: main}
    if release:
        tag = f'refs/tags/{release}'
        tagged = before.get(f'{tag}^{{}}', before.get(tag, ''))
        if tagged not in ('', main):
            raise RefusedError(f'release {release} is {tagged[:10]} already: choose another version')
        tagger = git(here, *committer, 'var', 'GIT_COMMITTER_IDENT')
        text = f'object {main}\ntype commit\ntag {release}\ntagger {tagger}\nRelease {release}\n'
        after[tag] = before.get(tag) or git(here, 'mktag', text=text).strip()
    moved = {name: new for name, new in after.items() if before.get(name) != new}
    if moved and not is_dry_run:
        pushed = [f'{new}:{name}' for name, new in moved.items()]
        if not before:
            git(here, 'push', '--quiet', remote, pushed[0])
        git(here, 'push', '--quiet', '--atomic', remote, *pushed)
    word = 'would push' if is_dry_run else 'pushed'
    return [f'{word} {name} {before.get(name, "new")[:10]} -> {new[:10]}' for name, new in moved.items()]


def address_advice(here: Path, remote: str) -> str:
    """Return what to set if the mirror's README names another address than that of the remote, or ''."""
    address = generate.load_table(here)['trees']['mirror']['address']
    if address_of(remote).removesuffix('.git') == address_of(address).removesuffix('.git'):
        return ''
    return (
        f'the mirror\'s README names {address}, not {remote}: set address = "{address_of(remote)}"'
        ' under [trees.mirror] in tools/twins.toml, run make generate, and commit'
    )


def default_branch_advice(here: Path, remote: str) -> str:
    """Return what to set if a clone of the remote does not begin with `ready`, or ''."""
    if git(here, 'ls-remote', '--symref', remote, 'HEAD').startswith(f'ref: {READY}\t'):
        return ''
    return (
        'set the default branch of the remote to ready, in the settings of the project (in a bare repository,'
        f' git symbolic-ref HEAD {READY}): colcon finds no packages in a clone of another branch'
    )


def main(arguments: list[str] | None = None) -> int:
    """Publish to the remote on the command line; return the exit code."""
    parser = Parser('mirror-publish', description=__doc__.splitlines()[1], allow_abbrev=False)
    parser.add_argument('remote', help='URL or name of the repository to publish to')
    parser.add_argument('--release', default='', metavar='VERSION', help='tag the commit with this version')
    parser.add_argument('--dry-run', action='store_true', help='print what would be pushed, and push nothing')
    parser.add_argument('--root', type=Path, default=ROOT, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    here, is_dry_run = options.root, options.dry_run
    try:
        if not options.remote:
            raise RefusedError('no remote: make mirror-publish REMOTE=URL')
        if 'OWNER' in options.remote:
            raise RefusedError(f'OWNER in REMOTE={options.remote} is a placeholder: write who owns it')
        url = git(here, 'ls-remote', '--get-url', options.remote).strip()
        remote = str(Path(url).resolve()) if Path(url).is_dir() else url
        advice = address_advice(here, remote)
        if advice and not is_dry_run:
            raise RefusedError(advice)
        lines = publish(here, remote, options.release, is_dry_run=is_dry_run)
        print(*lines or ['nothing to publish'], sep='\n')
        if not is_dry_run:
            advice = default_branch_advice(here, remote)
        if advice:
            print(f'mirror-publish: {advice}')
    except RefusedError as error:
        print(f'mirror-publish: {error}', file=sys.stderr)
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
