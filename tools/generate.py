"""
Write the monorepo's and the mirror's packages from the shared core (tools/core, tools/twins.toml).

Exit code: 0 the trees are what the core generates, 1 (--check) they are not, 2 nothing was written: the
table or the core is wrong, a package that the core owns holds a file that is not from the core, or somebody
has edited a generated file.
"""

import argparse
import difflib
import hashlib
import os
import re
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NoReturn

from check_drift import LEFT_BY_TOOLS, pluralized

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parent.parent
CORE = 'tools/core'
MESSAGES = 'lupin_msgs'  # the message package in the core
# The same text in both trees, which both have a CONTRIBUTING.md.
HEADER = 'Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md'
COMMENTS = dict.fromkeys(('.cfg', '.msg', '.py', '.srv', '.yaml'), '# {}\n')
COMMENTS |= dict.fromkeys(('.md', '.xml'), '<!-- {} -->\n')
COMMENTS['.rst'] = '.. {}\n\n'
FIRST_LINES = re.compile(rb'(#!.*\n|#.*(PYTHON_ARGCOMPLETE_OK|coding[:=]).*\n|<\?xml.*\?>\n)*')
# How the mirror's README gets the mirror into a workspace: by its address, or without one from the monorepo.
CLONE = 'git clone --branch ready {} ~/lupin_ws/src/lupin_greenhouse_ros'
COPY = """cp -r lupin_greenhouse_ros ~/lupin_ws/src/  # from a clone of the monorepo, or where your copy is
rm ~/lupin_ws/src/lupin_greenhouse_ros/COLCON_IGNORE  # hides this folder from colcon inside the monorepo"""
CLONE_OR_COPY = re.compile(
    rb'^(git clone --branch ready .*|cp -r lupin_greenhouse_ros .*\nrm .*)$', re.MULTILINE
)
File = tuple[bytes, int]  # content, and mode as git keeps it
Files = dict[str, File]  # by path, with /
Table = dict[str, Any]


class RefusedError(Exception):
    """The reason why nothing was changed, and the fix."""


def git(folder: Path, *arguments: str, text: str = '') -> str:
    """Run git with a text on its standard input; return what it prints. Raises RefusedError if it fails."""
    result = subprocess.run(
        ['git', '-c', 'log.showSignature=false', *arguments], cwd=folder, input=text,
        capture_output=True, check=False, encoding='utf-8', errors='surrogateescape',
    )  # fmt: skip
    if result.returncode:
        reason = result.stderr.strip() or result.stdout.strip() or f'exit code {result.returncode}'
        raise RefusedError(f'git {arguments[0]}: {reason}')
    return result.stdout


def load_table(root: Path) -> Table:
    """Return the table of the two trees; raises RefusedError if the file is not TOML."""
    try:
        return dict(tomllib.loads((root / 'tools/twins.toml').read_text(encoding='utf-8')))
    except (OSError, ValueError) as error:
        raise RefusedError(f'tools/twins.toml: {error}') from error


def read(path: Path) -> File | None:
    """Return content and mode of a plain file; None if there is none."""
    if path.is_symlink() or not path.is_file():
        return None
    return path.read_bytes(), 0o755 if os.access(path, os.X_OK) else 0o644


def render(root: Path) -> Files:
    """Return every generated file of both trees; raises RefusedError if table and core do not match."""
    table, core = load_table(root), _read_core(root)
    rendered = {}
    for tree in table['trees'].values():
        files = core.copy()
        if divergence := tree.get('divergence'):
            content, mode = core.get(divergence['file'], (b'', 0))
            files[divergence['file']] = exchange(content, divergence, 'core', 'tree'), mode
        for core_path, (content, mode) in files.items():
            path = tree_path(tree, core_path)
            text = with_header(path, content.replace(MESSAGES.encode(), tree['messages'].encode()))
            rendered[path] = text, mode
    return rendered | _readme_with_address(root, table['trees']['mirror'])


def _read_core(root: Path) -> Files:
    files = {}
    # A file at the top of the core, such as a README, only describes it.
    for path in _listed(root, f':(glob){CORE}/*/**'):
        file = read(root / path)
        if not file:
            raise RefusedError(f'{root / path}: is a symlink: generated trees hold plain files')
        files[path.removeprefix(f'{CORE}/')] = file
    return files


def exchange(content: bytes, divergence: Table, old: str, new: str) -> bytes:
    """Exchange the text of one side of the divergence for that of the other; raises RefusedError."""
    text = divergence[old].encode()
    if (found := content.count(text)) != 1:
        raise RefusedError(
            f'{divergence["file"]}: must have {divergence[old].strip()!r} once, but has it {found} times:'
            ' this is the line in which the trees differ, from tools/twins.toml'
        )
    return content.replace(text, divergence[new].encode())


def _readme_with_address(root: Path, mirror: Table) -> Files:
    path, address = f'{mirror["root"]}/README.md', mirror['address']
    content, mode = read(root / path) or (b'', 0)
    command = CLONE.format(address) if address else COPY
    content, count = CLONE_OR_COPY.subn(lambda _: command.encode(), content)
    if count != 1:
        raise RefusedError(f'{path}: must have `{CLONE.format("ADDRESS")}` once, or in its place\n{COPY}')
    return {path: (content, mode)}


def tree_path(tree: Table, core_path: str) -> str:
    """Return where a tree has a file of the core, from the root of the repository."""
    return f'{tree["root"]}/{core_path}'.replace(MESSAGES, tree['messages'])


def header_of(path: str) -> bytes:
    """Return the comment that a generated file has; empty if files of this kind have no comments."""
    return COMMENTS.get(Path(path).suffix, '').format(HEADER).encode()


def with_header(path: str, content: bytes) -> bytes:
    """Return a file's content with its header, after the lines that must stay first."""
    header = header_of(path)
    if header and header in content:
        raise RefusedError(f'{CORE}: {path}: holds the line of a generated file: remove it')
    return FIRST_LINES.sub(lambda first: first[0] + header, content, count=1)


def _listed(root: Path, *folders: str) -> list[str]:
    """Return the files below folders of the checkout, without what git ignores and what tools leave there."""
    tracked, others = (
        git(root, 'ls-files', '-z', *options, '--', *folders).split('\0')[:-1]
        for options in (['--cached'], ['--others', '--exclude-standard'])
    )
    found = {*tracked, *(path for path in others if not LEFT_BY_TOOLS.fullmatch(path.partition('/')[2]))}
    return sorted(path for path in found if os.path.lexists(root / path))


def compare(root: Path) -> tuple[Files, dict[str, str]]:
    """
    Return the rendered files and the findings in the trees, both by path. Raises RefusedError.

    A file is wrong if it differs from the rendered one. In the packages that the core owns, a file is also
    wrong if the core does not render it, unless git ignores it.
    """
    rendered, table = render(root), load_table(root)
    stale = [path for path, file in rendered.items() if read(root / path) != file]
    findings = {path: _difference(root, path, rendered[path]) for path in stale}
    packages = [f'{tree["root"]}/{name}' for tree in table['trees'].values() for name in table['owned']]
    unknown = [path for path in _listed(root, *packages) if path not in rendered]
    return rendered, findings | {path: f'{path}: is not from the core' for path in unknown}


def _difference(root: Path, path: str, rendered: File) -> str:
    file = read(root / path)
    if not file:
        return f'{path}: missing, or not a plain file'
    if file[0] == rendered[0]:
        return f'{path}: has mode {file[1]:o}, the core {rendered[1]:o}'
    try:
        old, new = (content.decode().split('\n') for content, _ in (rendered, file))
    except UnicodeDecodeError:
        return f'{path}: differs from what the core generates, and is not text'
    diff = difflib.unified_diff(old, new, f'{path} (generated)', f'{path} (in the tree)', lineterm='')
    return '\n'.join([f'{path}: differs from what the core generates', *diff])


def refuse_to_lose(root: Path, rendered: Files, findings: dict[str, str]) -> None:
    """Raise RefusedError if write() would remove or overwrite somebody's work."""
    # Git's names of the contents that were committed, or written last: any other one is an edit.
    last_written = _last_written(root)
    known = git(root, 'ls-tree', '-r', 'HEAD') + (last_written.read_text() if last_written.exists() else '')
    existing = {path for path in findings if (root / path).is_file()}
    edited = {path for path in existing if _blob((root / path).read_bytes()) not in known}
    if lost := [path for path in findings if path in edited or path not in rendered]:
        raise RefusedError(
            'nothing was written: a generated file was edited, or a file is not from the core. Make the edit'
            ' in tools/core (for the address of the mirror, in tools/twins.toml), or move the file. To drop'
            ' all edits: make generate ARGS=--force\n' + '\n'.join(findings[path] for path in lost)
        )


def _last_written(root: Path) -> Path:
    return root / git(root, 'rev-parse', '--git-path', 'generated_from_core').strip()


def _blob(content: bytes) -> str:
    """Return the name that git gives to a content."""
    return hashlib.sha1(b'blob %d\0' % len(content) + content, usedforsecurity=False).hexdigest()


def write(root: Path, rendered: Files, findings: Iterable[str]) -> None:
    """Write what is rendered to the paths that compare() has found, and remove the others of these."""
    for path in findings:
        if path in rendered:
            write_file(root / path, rendered[path])
        else:
            (root / path).unlink()
    _last_written(root).write_text('\n'.join(_blob(content) for content, _ in rendered.values()))


def write_file(path: Path, file: File) -> None:
    """Write a plain file in place of whatever file is there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)  # it may be a symlink
    path.write_bytes(file[0])
    path.chmod(file[1])


class Parser(argparse.ArgumentParser):
    """A parser whose error is one line."""

    def error(self, message: str) -> NoReturn:
        """End the program with one line, without the list of all options."""
        self.exit(2, f'{self.prog}: {message}: see --help\n')


def main(arguments: list[str] | None = None) -> int:
    """Generate, or with --check compare; return the exit code."""
    parser = Parser('generate', description=__doc__.splitlines()[1], allow_abbrev=False)
    what = parser.add_mutually_exclusive_group()
    what.add_argument('--check', action='store_true', help='compare only; write nothing')
    what.add_argument('--force', action='store_true', help='drop edits, and files that are not from the core')
    parser.add_argument('--root', type=Path, default=ROOT, help='the checkout; default: this one')
    options = parser.parse_args(arguments)
    try:
        rendered, findings = compare(options.root)
        if not options.check:
            if not options.force:
                refuse_to_lose(options.root, rendered, findings)
            write(options.root, rendered, findings)
    except (RefusedError, OSError, KeyError) as error:
        reason = f'tools/twins.toml: {error} is missing' if isinstance(error, KeyError) else error
        print(f'generate: {reason}', file=sys.stderr)
        return 2
    if options.check:
        end = f'{len(rendered)} generated files are what the core generates'
        if findings:
            counted = pluralized(len(findings), 'finding')
            end = f'{counted}. Edit tools/core, never a generated file; then: make generate'
        print(*findings.values(), end, sep='\n')
        return int(bool(findings))
    changed = [path if path in rendered else f'{path} (removed)' for path in findings]
    counted = f'{len(findings.keys() & rendered.keys())} changed'
    print(*changed, f'{pluralized(len(rendered), "file")} generated, {counted}', sep='\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
