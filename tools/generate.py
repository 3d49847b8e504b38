"""
Write the monorepo's and the mirror's packages from the shared core (tools/core, tools/twins.toml).

    python3 tools/generate.py            write what the core renders, and nothing else
    python3 tools/generate.py --check    compare only; write nothing
    python3 tools/generate.py --prune    write, and remove what the core does not render (after a rename)
    python3 tools/generate.py --force    write, also over an edit of a generated file

Exit code: 0 the trees are what the core generates, 1 (--check) they are not, 2 nothing was written: the
table or the core is wrong, a package that the core owns holds a file that is not from the core, or somebody
has edited a generated file.
"""

import argparse
import difflib
import os
import re
import stat
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from check_drift import pluralized

if sys.version_info >= (3, 11):
    import tomllib
else:
    try:
        import tomli as tomllib
    except ModuleNotFoundError:
        sys.exit('generate: Python 3.10 needs tomli: sudo apt install python3-tomli, or run `make generate`')

ROOT = Path(__file__).resolve().parent.parent
CORE = 'tools/core'
MESSAGES = 'lupin_msgs'  # the message package in the core
# One text for both trees, so that they do not differ by it; each has a page of this name.
HEADER = 'Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md'
COMMENTS = dict.fromkeys(('.cfg', '.msg', '.py', '.rviz', '.srv', '.yaml'), '# {}\n')
COMMENTS |= dict.fromkeys(('.html', '.md', '.xml'), '<!-- {} -->\n')
COMMENTS |= {'.js': '// {}\n', '.rst': '.. {}\n\n'}
FIRST_LINES = re.compile(
    rb'(#!.*\n|#.*(PYTHON_ARGCOMPLETE_OK|coding[:=]).*\n|<\?xml.*\?>\n|<!doctype .*>\n)*', re.IGNORECASE
)
# Where the mirror's README has the mirror's address.
ADDRESS = re.compile(rb'(?<=git clone --branch ready )\S+(?= src/)|(?<=    url: )\S+')
File = tuple[bytes, int]  # content, and mode as git keeps it
Files = dict[str, File]  # by path, with /
Table = dict[str, Any]


class RefusedError(Exception):
    """The reason why nothing was changed, and the fix."""


def load_table(root: Path) -> Table:
    """Return the table of the two trees; raises RefusedError if the file is not TOML."""
    try:
        return dict(tomllib.loads((root / 'tools/twins.toml').read_text(encoding='utf-8')))
    except (OSError, ValueError) as error:
        raise RefusedError(f'tools/twins.toml: {error}') from error


def render(root: Path, table: Table) -> Files:
    """Return every generated file of both trees; raises RefusedError if table and core do not match."""
    core = _read_core(root)
    rendered = {}
    for name, tree in table['trees'].items():
        for core_path, (content, mode) in _diverged(tree, core).items():
            path = tree_path(tree, core_path)
            text = with_header(path, content.replace(MESSAGES.encode(), tree['messages'].encode()))
            for word in tree['forbidden']:
                if word.lower().encode() in path.lower().encode() + text.lower():
                    raise RefusedError(f'tools/twins.toml, {name}: {word!r} must not be in {path}')
            rendered[path] = text, mode
    return rendered | _readme_with_address(root, table['trees']['mirror'])


def tree_path(tree: Table, core_path: str) -> str:
    """Return where a tree has a file of the core, from the root of the repository."""
    return f'{tree["root"]}/{core_path}'.replace(MESSAGES, tree['messages'])


def _diverged(tree: Table, core: Files) -> Files:
    files = dict(core)
    for divergence in tree.get('divergences', []):
        path, find, replace = divergence['file'], divergence['core'], divergence['tree']
        content, mode = files.get(path, (b'', 0))
        if (found := content.count(find.encode())) != 1:
            raise RefusedError(f'tools/twins.toml: {find!r} must be once in {path}, and is {found} times')
        files[path] = content.replace(find.encode(), replace.encode()), mode
    return files


def with_header(path: str, content: bytes) -> bytes:
    """Return a file's content with a comment that says so, after the lines that must stay first."""
    header, place = _header_and_place(path, content)
    if header and header in content:
        raise RefusedError(f'{CORE}: {path}: holds the line of a generated file: remove it')
    return content[:place] + header + content[place:]


def without_header(path: str, content: bytes) -> bytes:
    """Return a file's content without what with_header() adds."""
    header, place = _header_and_place(path, content)
    return content[:place] + content[place:].removeprefix(header)


def _header_and_place(path: str, content: bytes) -> tuple[bytes, int]:
    header = COMMENTS.get(Path(path).suffix, '').format(HEADER).encode()
    first = FIRST_LINES.match(content)
    return header, first.end() if first else 0


def _readme_with_address(root: Path, mirror: Table) -> Files:
    path = f'{mirror["root"]}/README.md'
    content, count = ADDRESS.subn(mirror['address'].encode(), (root / path).read_bytes())
    if count != 2:
        raise RefusedError(f'{path}: must have `git clone --branch ready ADDRESS src/...` and `url: ADDRESS`')
    return {path: (content, _mode(root / path))}


def _read_core(root: Path) -> Files:
    files = {}
    for path in _listed(
        root, f':(glob){CORE}/*/**'
    ):  # a file at the top, such as a README, describes the core
        file = read(root / path)
        if not file:
            raise RefusedError(f'{root / path}: is a symlink: generated trees hold plain files')
        files[path.removeprefix(f'{CORE}/')] = file
    if not files:
        raise RefusedError(f'{root / CORE}: holds no files')
    return files


def _listed(root: Path, *folders: str) -> list[str]:
    """Return the files below folders of the checkout, without those that git ignores."""
    arguments = ('ls-files', '-z', '--cached', '--others', '--exclude-standard', '--', *folders)
    return sorted({path for path in git(root, *arguments).split('\0')[:-1] if os.path.lexists(root / path)})


def git(folder: Path, *arguments: str, text: str = '') -> str:
    """Run git with a text on its standard input; return what it prints. Raises RefusedError if it fails."""
    result = subprocess.run(
        ['git', *arguments], cwd=folder, input=text, capture_output=True, check=False,
        encoding='utf-8', errors='surrogateescape',
    )  # fmt: skip
    if result.returncode:
        told = result.stderr.strip() or result.stdout.strip() or f'exit code {result.returncode}'
        raise RefusedError(f'git {arguments[0]}: {told}')
    return result.stdout


def _mode(path: Path) -> int:
    return 0o755 if path.stat().st_mode & stat.S_IXUSR else 0o644


def read(path: Path) -> File | None:
    """Return content and mode of a plain file; None if there is none."""
    return (path.read_bytes(), _mode(path)) if path.is_file() and not path.is_symlink() else None


def extras(root: Path, rendered: Files, table: Table) -> list[str]:
    """Return the files of the owned packages that are neither rendered nor ignored by git."""
    packages = [f'{tree["root"]}/{name}' for tree in table['trees'].values() for name in table['owned']]
    return [path for path in _listed(root, *packages) if path not in rendered]


def differing(root: Path, rendered: Files) -> list[str]:
    """Return the paths whose file is not what is rendered."""
    return [path for path, file in rendered.items() if read(root / path) != file]


def difference(root: Path, path: str, rendered: File) -> str:
    """Return how a file of a tree differs from what is rendered."""
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


def edited(root: Path, paths: list[str]) -> list[str]:
    """Return the files whose content is neither that of HEAD nor what was written last."""
    existing = [path for path in paths if (root / path).is_file()]
    known = set(git(root, 'ls-tree', '-r', 'HEAD').split())
    if _last_written(root).exists():
        known.update(_last_written(root).read_text().split())
    return [path for path, blob in zip(existing, _blobs(root, existing), strict=True) if blob not in known]


def _last_written(root: Path) -> Path:
    """Return the file in git's folder that lists the blobs that were written last."""
    return root / git(root, 'rev-parse', '--git-path', 'generated_from_core').strip()


def _blobs(root: Path, paths: Iterable[str]) -> list[str]:
    return git(root, 'hash-object', '--stdin-paths', text='\n'.join(paths)).split()


def write(root: Path, rendered: Files) -> list[str]:
    """Write the rendered files, and remember what was written; return the paths that changed."""
    changed = differing(root, rendered)
    for path in changed:
        content, mode = rendered[path]
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).unlink(missing_ok=True)  # it may be a symlink
        (root / path).write_bytes(content)
        (root / path).chmod(mode)
    _last_written(root).write_text('\n'.join(_blobs(root, rendered)))
    return changed


def generate(root: Path, *, is_check: bool, is_prune: bool, is_force: bool) -> int:
    """Generate or compare, and print what changed; return the exit code. Raises RefusedError."""
    table = load_table(root)
    rendered = render(root, table)
    unknown = extras(root, rendered, table)
    if is_check:
        findings = [difference(root, path, rendered[path]) for path in differing(root, rendered)]
        findings += [f'{path}: not generated from the core' for path in unknown]
        counted = pluralized(len(findings), 'finding')
        advice = f'{counted}. Edit tools/core, never a generated file; then: make generate'
        end = advice if findings else f'{len(rendered)} generated files are what the core generates'
        print(*findings, end, sep='\n')
        return int(bool(findings))
    if unknown and not is_prune:
        raise RefusedError(
            'nothing was written. Move a file of your own into tools/core, or out of the package;'
            ' remove what a rename left behind with: make generate ARGS=--prune\n'
            + '\n'.join(f'{path}: is not from the core' for path in unknown)
        )
    edits = [] if is_force else edited(root, differing(root, rendered))
    if edits:
        raise RefusedError(
            'nothing was written. Somebody has edited what is generated. Make this edit in tools/core (of the'
            ' address, in tools/twins.toml); to drop it: make generate ARGS=--force\n'
            + '\n'.join(difference(root, path, rendered[path]) for path in edits)
        )
    changed = write(root, rendered)
    for path in unknown:
        (root / path).unlink()
    for line in [*changed, *(f'{path} (removed)' for path in unknown)]:
        print(line)
    print(f'{pluralized(len(rendered), "file")} generated, {len(changed)} changed')
    return 0


def main(arguments: list[str] | None = None) -> int:
    """Generate, or with --check compare; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    what = parser.add_mutually_exclusive_group()
    what.add_argument('--check', action='store_true', help='compare only; write nothing')
    what.add_argument('--prune', action='store_true', help='remove files that the core does not render')
    parser.add_argument('--force', action='store_true', help='overwrite edits of generated files')
    parser.add_argument('--root', type=Path, default=ROOT, help='the checkout; default: this one')
    options = parser.parse_args(arguments)
    try:
        return generate(options.root, is_check=options.check, is_prune=options.prune, is_force=options.force)
    except (RefusedError, OSError) as error:
        print(f'generate: {error}', file=sys.stderr)
    except KeyError as error:
        print(f'generate: tools/twins.toml: {error} is missing', file=sys.stderr)
    return 2


if __name__ == '__main__':
    sys.exit(main())
