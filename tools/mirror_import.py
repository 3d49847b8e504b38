"""
Import patches of the open-source mirror: each becomes a commit of the core and both trees.

    make mirror-import PATCH=N.patch

PATCH is the file that GitHub serves for a pull request at its address plus .patch, or the output of
git format-patch --stdout. In a work tree of its own, the program applies each patch to
lupin_greenhouse_ros/, takes the changed files over into the core, and generates both trees. A commit has the
author, date and message of its patch.
Exit code: 0 the whole series is imported, 1 nothing is, 2 there is no such file, or there are own changes.
"""

import os
import re
import signal
import sys
import tempfile
from pathlib import Path

import check_drift
import generate
from generate import CORE, MESSAGES, ROOT, RefusedError, Table, git


def core_path_of(path: str, table: Table, checkout: Path) -> str:
    """Return where the core has a file of the mirror, '' if it is kept by hand; raises RefusedError."""
    mirror = table['trees']['mirror']
    name = path.removeprefix(f'{mirror["root"]}/').replace(mirror['messages'], MESSAGES)
    if path == generate.tree_path(mirror, name):
        if name in check_drift.MIRROR_ALONE:
            return ''
        if name.partition('/')[0] in table['owned'] or (checkout / CORE / name).is_file():
            return name
    raise RefusedError(f'{path}: is not a file of the mirror')


def core_content(core_path: str, content: bytes, mirror: Table) -> bytes:
    """Return what the core must contain for a file of the mirror; raises RefusedError."""
    content = content.replace(generate.header_of(core_path), b'', 1)
    if MESSAGES.encode() in content:
        raise RefusedError(f'{core_path}: names {MESSAGES}: in the mirror, it is {mirror["messages"]}')
    if core_path == mirror['divergence']['file']:
        content = generate.exchange(content, mirror['divergence'], 'tree', 'core')
    return content.replace(mirror['messages'].encode(), MESSAGES.encode())


def take_over(checkout: Path, table: Table) -> None:
    """Amend the last commit, which changes the mirror, by the core and both trees; raises RefusedError."""
    changed = git(checkout, 'diff', '--name-only', '-z', '--no-renames', 'HEAD~', 'HEAD').split('\0')[:-1]
    core_paths = {path: core_path_of(path, table, checkout) for path in changed}
    for core_path in filter(None, core_paths.values()):  # all of them first: a folder may replace a file
        (checkout / CORE / core_path).unlink(missing_ok=True)
    for path, core_path in core_paths.items():
        file = generate.read(checkout / path)
        if not file and os.path.lexists(checkout / path):
            raise RefusedError(f'{path}: is not a plain file')
        if file and core_path:
            content = core_content(core_path, file[0], table['trees']['mirror'])
            generate.write_file(checkout / CORE / core_path, (content, file[1]))
            git(checkout, 'add', '--force', '--', f'{CORE}/{core_path}')  # git may ignore it
    rendered, findings = generate.compare(checkout)
    generate.write(checkout, rendered, findings)
    git(checkout, 'add', '--force', '--', *rendered)
    git(checkout, 'add', '--all')
    trees = (check_drift.Tree(name, checkout / tree['root']) for name, tree in table['trees'].items())
    for found in check_drift.compare(*trees):
        raise RefusedError(f'{found.path.relative_to(checkout)}: {found.message}')
    git(checkout, 'commit', '--quiet', '--amend', '--no-edit')


def import_patch(checkout: Path, patch: Path, table: Table) -> None:
    """Commit a patch in the checkout, if it is not there yet. Raises RefusedError with its subject."""
    diff = patch.with_suffix('.diff')
    text = patch.read_bytes().decode(errors='surrogateescape')
    told = git(checkout, 'mailinfo', '/dev/null', str(diff), text=text)
    subject = ''.join(re.findall(r'^Subject: (.*)', told, re.MULTILINE))
    before = git(checkout, 'rev-parse', 'HEAD')
    try:
        check_form(checkout, diff)
        apply(checkout, patch, table['trees']['mirror']['root'])
        if git(checkout, 'rev-parse', 'HEAD') == before:
            print(f'{subject!r} is here already')
        else:
            take_over(checkout, table)
    except RefusedError as error:
        raise RefusedError(f'{subject!r}: {error}') from error


def check_form(checkout: Path, diff: Path) -> None:
    """Raise RefusedError if git would take a patch for another one than its author made."""
    text = diff.read_bytes().decode(errors='replace')
    if re.search(r'^diff --git (?!"?a/)', text, re.MULTILINE):
        raise RefusedError(
            'has paths without a/ and b/: make it with git -c diff.noprefix=false format-patch'
        )
    summary = re.search(r'^ \d+ files? changed.*', text, re.MULTILINE)
    if summary and summary[0] != git(checkout, 'apply', '--stat', str(diff)).splitlines()[-1]:
        raise RefusedError(f'is not whole: its summary says{summary[0]}')


def apply(checkout: Path, patch: Path, root: str) -> None:
    """Commit a patch of the mirror below its root; raises RefusedError."""
    try:
        git(checkout, 'am', '--quiet', '--3way', '--keep-cr', f'--directory={root}', str(patch))
    except RefusedError as error:
        told = str(error).removeprefix('git am: ').splitlines()  # with hints
        reason = next((line for line in told if line.startswith('error: ')), told[0])
        raise RefusedError(f'does not apply to {root}: {reason}') from error


def split(series: Path, folder: Path) -> list[Path]:
    """Write each patch of a file into the folder; return their paths. Raises RefusedError."""
    content = series.read_bytes()
    # A CR belongs to the patch, unless every line got one when the file was saved.
    keep_cr = [] if content.count(b'\n') == content.count(b'\r\n') else ['--keep-cr']
    try:
        git(folder, 'mailsplit', *keep_cr, f'-o{folder}', str(series.resolve()))
    except RefusedError as error:
        raise RefusedError(f'{series} holds no patch of git format-patch') from error
    return sorted(folder.iterdir())


def import_series(series: Path, folder: Path) -> None:
    """Import a file of patches by way of a work tree in the folder; raises RefusedError."""
    checkout, patches = folder / 'checkout', folder / 'patches'
    patches.mkdir()
    git(ROOT, 'worktree', 'add', '--quiet', '--detach', str(checkout))
    try:
        table = generate.load_table(checkout)
        for patch in split(series, patches):
            import_patch(checkout, patch, table)
        end = git(checkout, 'rev-parse', 'HEAD').strip()
    finally:
        for number in (signal.SIGINT, signal.SIGTERM):  # they would leave half a work tree, or half a merge
            signal.signal(number, signal.SIG_IGN)
        git(ROOT, 'worktree', 'remove', '--force', str(checkout))
    print(git(ROOT, 'log', '--reverse', '--stat', '--format=%h %an: %s', f'HEAD..{end}'), end='')
    git(ROOT, 'merge', '--quiet', '--ff-only', end)


def main() -> int:
    """Import the file on the command line; return the exit code."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    series = Path(*sys.argv[1:2])
    if not series.is_file():
        what = 'a folder' if sys.argv[1:] != [''] and series.is_dir() else 'no file'
        print(f'mirror-import: PATCH={sys.argv[-1]} is {what}: write PATCH=N.patch', file=sys.stderr)
        return 2
    try:
        if git(ROOT, 'status', '--porcelain'):
            print('mirror-import: commit or stash your own changes first', file=sys.stderr)
            return 2
        with tempfile.TemporaryDirectory(prefix='mirror-import-') as folder:
            import_series(series, Path(folder))
    except (RefusedError, OSError) as error:
        print(f'mirror-import: nothing was changed: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == '__main__':
    sys.exit(main())
