"""
Publish the mirror: its history, the branch `ready`, the source of each commit, and a release.

    make mirror-publish REMOTE=URL [RELEASE=1.2.0] [ARGS=--dry-run]

`main` is the history of lupin_greenhouse_ros/, split out of the last commit here. Its README has the address
of the remote instead of URL_OF_THIS_REPOSITORY. It only moves forward. `ready` is `main` without
COLCON_IGNORE, for `vcs import`. A git note on each commit of `main` names the source commit here
(refs/notes/commits). A release is a tag with the version of both packages. The program pushes either
everything or nothing. Exit code: 0 published, or nothing to do; 1 refused.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parents[1]
MIRROR = 'lupin_greenhouse_ros'
PACKAGES = ('lupin_greenhouse_msgs', 'lupin_greenhouse_bridge')
NOTES = 'refs/notes/commits'
PLACEHOLDER = 'URL_OF_THIS_REPOSITORY'
SECTION = re.compile(r'^(.+)\n-+$', re.MULTILINE)  # of a changelog
# On these hosts a repository has the same path by https as by ssh.
HTTPS_TOO = ('github.com', 'gitlab.com', 'gitlab.tudelft.nl', 'codeberg.org')
# What identifies a commit on both sides of the split, besides its tree.
IDENTITY = '%an%x00%ae%x00%ad%x00%B'


class PublishError(Exception):
    """The reason why nothing is published, and the fix."""


def address_of(remote: str) -> str:
    """Return the address that a reader can clone: without credentials, and with https if possible."""
    by_ssh = re.fullmatch(r'(?:ssh://)?git@([^:/]+)(?::\d+/|[:/])(.+)', remote)
    if by_ssh and by_ssh[1] in HTTPS_TOO:
        return f'https://{by_ssh[1]}/{by_ssh[2]}'
    return re.sub(r'^(https?://)[^/@]*@', r'\1', remote)


class Repository:
    """A git repository, by its folder."""

    def __init__(self, folder: Path):
        self.folder = folder

    def git(self, *arguments: str, text: str = '', **environment: str) -> str:
        """Run git and return its output, stripped; raises PublishError with its error message."""
        return self.exactly(*arguments, text=text, **environment).strip()

    def exactly(self, *arguments: str, text: str = '', **environment: str) -> str:
        """Run git and return its output, not stripped; raises PublishError."""
        result = subprocess.run(
            ['git', *arguments],
            cwd=self.folder,
            input=text,
            env={**os.environ, **environment},
            capture_output=True,
            text=True,
            check=False,
        )
        if result.returncode:
            raise PublishError(f'git {arguments[0]}: {result.stderr.strip()}')
        return result.stdout

    def commit(self, name: str) -> str:
        """Return the commit of a name; '' if there is none."""
        try:
            return self.git('rev-parse', '--quiet', '--verify', f'{name}^{{commit}}')
        except PublishError:
            return ''

    def is_ancestor(self, old: str, new: str) -> bool:
        """Return whether `old` is in the history of `new`; a name without a commit is in every history."""
        return not self.commit(old) or self.git('merge-base', old, new) == self.commit(old)

    def tree_without_ignore(self, commit: str) -> str:
        """Return the tree of a commit without COLCON_IGNORE."""
        entries = self.git('ls-tree', commit).splitlines()
        kept = [f'{entry}\n' for entry in entries if not entry.endswith('\tCOLCON_IGNORE')]
        return self.git('mktree', text=''.join(kept))


def check_this_checkout(here: Repository) -> None:
    """Raise PublishError if the last commit must not be published."""
    if here.git('status', '--porcelain'):
        raise PublishError('there are uncommitted changes: commit or stash them')
    if here.git('rev-parse', '--is-shallow-repository') == 'true':
        raise PublishError('this clone has a part of the history only: git fetch --unshallow')
    checks = (
        ['tools/generate.py', '--check'],
        ['tools/check_drift.py', '--monorepo', 'monorepo', '--mirror', MIRROR],
    )
    for check in checks:
        result = subprocess.run(
            [sys.executable, *check], cwd=here.folder, capture_output=True, text=True, check=False
        )
        if result.returncode:
            raise PublishError(f'{check[0]} fails:\n{result.stdout}{result.stderr}'.rstrip())


def sources(here: Repository, split: str) -> dict[str, str]:
    """Return the source commit here of each commit of the split history."""
    commits = here.git('rev-list', 'HEAD', '--', MIRROR).split()
    asked = ''.join(f'{commit}:{MIRROR}\n' for commit in commits)
    trees = [line.split()[0] for line in here.git('cat-file', '--batch-check', text=asked).splitlines()]
    by_key = {
        (tree, here.git('show', '-s', f'--format={IDENTITY}', commit)): commit
        for tree, commit in zip(trees, commits, strict=True)
    }
    found = {}
    for commit in here.git('rev-list', split).split():
        tree, _, identity = here.git('show', '-s', f'--format=%T%x00{IDENTITY}', commit).partition('\0')
        if (tree, identity) in by_key:
            found[commit] = by_key[tree, identity]
    return found


def with_address(published: Repository, found: dict[str, str], split: str, address: str) -> dict[str, str]:
    """
    Write the address into the README of each commit of the split history; return {commit: new commit}.

    A commit whose note shows that it is already published stays unchanged.
    """
    told = published.git('log', '--format=%H %N', '--branches')
    noted = re.findall(r'^(\w+) source: (\w+)$', told, re.MULTILINE)
    by_source = {source: commit for commit, source in noted}
    new: dict[str, str] = {}
    for commit in published.git('rev-list', '--reverse', '--topo-order', split).split():
        new[commit] = by_source.get(found.get(commit, ''), '') or _rewritten(published, commit, new, address)
    return new


def _rewritten(published: Repository, commit: str, new: dict[str, str], address: str) -> str:
    """Return the commit with the new commits of its parents and the address in its README."""
    head, gap, message = published.exactly('cat-file', 'commit', commit).partition('\n\n')
    tree, *lines = head.splitlines()
    entries = published.exactly('ls-tree', commit)
    readme = re.search(r' blob (\w+)\tREADME\.md$', entries, re.MULTILINE)
    text = published.exactly('cat-file', 'blob', readme[1]) if readme else ''
    if PLACEHOLDER in text:
        text = text.replace(PLACEHOLDER, address)
        blob = published.git('hash-object', '-w', '--stdin', text=text)
        tree = f'tree {published.git("mktree", text=entries.replace(readme[1], blob))}'
    lines = [tree, *(f'parent {new[line[7:]]}' if line.startswith('parent ') else line for line in lines)]
    text = '\n'.join(lines) + gap + message
    return published.git('hash-object', '-t', 'commit', '-w', '--stdin', text=text)


def check_release(published: Repository, main: str, release: str) -> None:
    """Raise PublishError if the packages have another version, or the tag names another commit."""
    for package in PACKAGES:
        text = published.git('show', f'{main}:{package}/package.xml')
        version = ElementTree.fromstring(text).findtext('version')  # noqa: S314 - our own
        if version != release:
            raise PublishError(f'release {release}: {package}/package.xml has version {version}')
        sections = SECTION.findall(published.git('show', f'{main}:{package}/CHANGELOG.rst'))
        if not sections[0].startswith(f'{release} ('):
            raise PublishError(
                f'release {release}: {package}/CHANGELOG.rst begins with {sections[0]}: give this section'
                ' the version and the date'
            )
    tagged = published.commit(f'refs/tags/{release}')
    if tagged not in ('', main):
        raise PublishError(f'release {release} is {tagged[:10]} already: choose another version')


def move_ready(published: Repository, main: str) -> None:
    """Move `ready` to `main` without COLCON_IGNORE; raises PublishError if `ready` has own changes."""
    ready = published.commit('refs/heads/ready')
    if ready:
        parents = published.git('show', '-s', '--format=%P', ready).split()
        if published.git('rev-parse', f'{ready}^{{tree}}') != published.tree_without_ignore(parents[-1]):
            raise PublishError('the branch ready has changes of its own: move them to main by a patch')
        if published.is_ancestor(main, ready):
            return
    date, name, email = published.git('show', '-s', '--format=%cI%n%cn%n%ce', main).splitlines()
    identity = {
        f'GIT_{who}_{what}': value
        for who in ('AUTHOR', 'COMMITTER')
        for what, value in (('DATE', date), ('NAME', name), ('EMAIL', email))
    }
    parents = [argument for parent in (ready, main) if parent for argument in ('-p', parent)]
    message = (
        'Merge main, without COLCON_IGNORE\n\nFor vcs import: colcon finds the packages of this branch.\n'
    )
    tree = published.tree_without_ignore(main)
    commit = published.git('commit-tree', tree, *parents, text=message, **identity)
    published.git('update-ref', 'refs/heads/ready', commit)


def add_notes(published: Repository, found: dict[str, str]) -> int:
    """Add a note with its source to each commit without one; return their number."""
    noted = {line.split()[1] for line in published.git('notes', 'list').splitlines()}
    missing = [(commit, source) for commit, source in found.items() if commit not in noted]
    for commit, source in missing:
        published.git('notes', 'add', '-m', f'source: {source}', commit)
    return len(missing)


def publish(here: Repository, remote: str, release: str, *, is_dry_run: bool) -> list[str]:
    """Publish, and return what was pushed; raises PublishError."""
    check_this_checkout(here)
    split = here.git('subtree', '-q', 'split', f'--prefix={MIRROR}')
    with tempfile.TemporaryDirectory(prefix='mirror-publish-') as folder:
        published = Repository(Path(folder))
        published.git('init', '--quiet', '--bare')
        # The author of the last commit also signs tags and notes: a build machine may have no git identity.
        for what, placeholder in (('name', '%cn'), ('email', '%ce')):
            published.git('config', f'user.{what}', here.git('show', '-s', f'--format={placeholder}'))
        published.git('fetch', '--quiet', remote, '+refs/*:refs/*')
        before = refs(published)
        published.git('fetch', '--quiet', str(here.folder), split)
        found = sources(here, split)
        new_commits = with_address(published, found, split, address_of(remote))
        found = {new_commits[commit]: source for commit, source in found.items()}
        split = new_commits[split]
        if not published.is_ancestor('refs/heads/main', split):
            raise PublishError(
                'main of the remote has commits that are not published from here: bring them in as patches'
                ' (make mirror-import PATCH=...); to drop them, remove them from the remote'
            )
        known = ['--not', 'refs/heads/main'] if 'refs/heads/main' in before else []
        new = published.git('rev-list', '--count', split, *known)
        published.git('update-ref', 'refs/heads/main', split)
        move_ready(published, split)
        notes = add_notes(published, found)
        if release:
            check_release(published, split, release)
            if not published.commit(f'refs/tags/{release}'):
                published.git('tag', '--annotate', '-m', f'Release {release}', release, split)
        after = refs(published)
        moved = [name for name in after if before.get(name) != after[name]]
        if moved and not is_dry_run:
            published.git('push', '--quiet', '--atomic', remote, *(f'{name}:{name}' for name in moved))
        counts = {'refs/heads/main': f', {new} commits', NOTES: f', {notes} notes'}
        return [
            f'{name} {before.get(name, "new")[:10]} -> {after[name][:10]}{counts.get(name, "")}'
            for name in moved
        ]


def refs(repository: Repository) -> dict[str, str]:
    """Return name and object of every ref."""
    lines = repository.git('for-each-ref', '--format=%(refname) %(objectname)').splitlines()
    return dict(line.split() for line in lines)


def main(arguments: list[str] | None = None) -> int:
    """Publish to the remote on the command line; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('remote', help='URL or name of the repository to publish to')
    parser.add_argument('--release', default='', metavar='VERSION', help='tag the commit with this version')
    parser.add_argument('--dry-run', action='store_true', help='print what would be pushed, and push nothing')
    parser.add_argument('--root', type=Path, default=ROOT, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if not options.remote:
        print('mirror-publish: no remote: make mirror-publish REMOTE=URL', file=sys.stderr)
        return 1
    here = Repository(options.root)
    remote = options.remote
    if '/' not in remote:
        try:
            remote = here.git('remote', 'get-url', remote)
        except PublishError:
            print(f'mirror-publish: {remote} is neither a URL nor a remote of this clone', file=sys.stderr)
            return 1
    elif Path(remote).is_dir():
        remote = str(Path(remote).resolve())
    try:
        lines = publish(here, remote, options.release, is_dry_run=options.dry_run)
    except PublishError as error:
        print(f'mirror-publish: {error}', file=sys.stderr)
        return 1
    word = 'would push' if options.dry_run else 'pushed'
    print(*(f'{word} {line}' for line in lines) if lines else ['nothing to publish'], sep='\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
