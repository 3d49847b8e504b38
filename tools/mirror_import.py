"""
Import patches of the open-source mirror: each becomes a commit of the core and both trees.

    make mirror-import PATCH=N.patch

PATCH is the file that GitHub serves for a pull request at its address plus .patch, or the output of
git format-patch --stdout. In a work tree of its own, the program applies each patch to lupin_greenhouse_ros/,
takes the changed files over into the core, and generates both trees. A commit has the author, date and
message of its patch.
Exit code: 0 the whole series is imported, 1 nothing is.
"""

import os
import sys
import tempfile
from pathlib import Path

import check_drift
import generate
from generate import CORE, MESSAGES, ROOT, Parser, RefusedError, Table, git

# These options keep the message unchanged, whatever the user's git settings are.
AM = ('am', '--quiet', '--3way', '--keep-non-patch', '--no-scissors', '--no-message-id')


def take_over(checkout: Path, table: Table) -> None:
    """Amend the last commit, which changes the mirror, by the core and both trees; raises RefusedError."""
    mirror = table['trees']['mirror']
    changed = git(checkout, 'diff', '--name-only', '-z', '--no-renames', 'HEAD~', 'HEAD').split('\0')[:-1]
    for path in changed:
        name = path.removeprefix(f'{mirror["root"]}/').replace(mirror['messages'], MESSAGES)
        in_core, file = checkout / CORE / name, generate.read(checkout / path)
        if not file and os.path.lexists(checkout / path):
            raise RefusedError(f'{path}: is not a plain file')
        if name in check_drift.MIRROR_ALONE:
            continue
        is_owned = name.partition('/')[0] in table['owned'] or in_core.is_file()
        if not is_owned or path != generate.tree_path(mirror, name):
            raise RefusedError(f'{path}: is not a file of the mirror')
        in_core.unlink(missing_ok=True)
        if file:
            generate.write_file(in_core, (core_content(name, file[0], mirror), file[1]))
    generate.write(checkout, *generate.compare(checkout))
    git(checkout, 'add', '--all')
    trees = (check_drift.Tree(name, checkout / tree['root']) for name, tree in table['trees'].items())
    for found in check_drift.compare(*trees):
        raise RefusedError(f'{found.path.relative_to(checkout)}: {found.message}')
    git(checkout, 'commit', '--quiet', '--amend', '--no-edit', '--cleanup=verbatim')


def core_content(name: str, content: bytes, mirror: Table) -> bytes:
    """Return what the core must contain for a file of the mirror; raises RefusedError."""
    content = content.replace(generate.header_of(name), b'', 1)
    if MESSAGES.encode() in content:
        raise RefusedError(f'{name}: names {MESSAGES}: in the mirror, it is {mirror["messages"]}')
    if name == mirror['divergence']['file']:
        content = generate.exchange(content, mirror['divergence'], 'tree', 'core')
    return content.replace(mirror['messages'].encode(), MESSAGES.encode())


def import_series(series: Path, folder: Path) -> str:
    """Import a file of patches by way of a work tree in the folder; return the log. Raises RefusedError."""
    checkout, patches = folder / 'checkout', folder / 'patches'
    patches.mkdir()
    git(folder, 'mailsplit', f'-o{patches}', str(series.resolve()))
    git(ROOT, 'worktree', 'add', '--quiet', '--detach', str(checkout))
    try:
        table = generate.load_table(checkout)
        for number, patch in enumerate(sorted(patches.iterdir()), start=1):
            before = git(checkout, 'rev-parse', 'HEAD')
            try:
                git(checkout, *AM, f'--directory={table["trees"]["mirror"]["root"]}', str(patch))
                if git(checkout, 'rev-parse', 'HEAD') != before:  # or the change is here already
                    take_over(checkout, table)
            except RefusedError as error:
                raise RefusedError(f'patch {number}: {error}') from error
        end = git(checkout, 'rev-parse', 'HEAD').strip()
    finally:
        git(ROOT, 'worktree', 'remove', '--force', str(checkout))
    log = git(ROOT, 'log', '--reverse', '--stat', '--format=%h %an: %s', f'HEAD..{end}')
    git(ROOT, 'merge', '--quiet', '--ff-only', end)
    return log or 'the patches are here already\n'


def main() -> int:
    """Import the file on the command line; return the exit code."""
    parser = Parser('mirror-import', description=__doc__.splitlines()[1], allow_abbrev=False)
    parser.add_argument('patch', type=Path, help='the file of patches')
    series = parser.parse_args().patch
    try:
        if not series.is_file():
            raise RefusedError(f'PATCH={series} is not a file: write PATCH=N.patch')
        if git(ROOT, 'status', '--porcelain'):
            raise RefusedError('commit or stash your own changes first')
        with tempfile.TemporaryDirectory(prefix='mirror-import-') as folder:
            print(import_series(series, Path(folder)), end='')
    except (RefusedError, OSError) as error:
        print(f'mirror-import: nothing was changed: {error}', file=sys.stderr)
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
