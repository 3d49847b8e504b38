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

from check_drift import pluralized

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    try:
        import tomli as tomllib
    except ModuleNotFoundError:
        sys.exit('generate: Python 3.10 needs tomli: sudo apt install python3-tomli, or run `make generate`')

ROOT = Path(__file__).resolve().parent.parent
CORE = 'tools/core'
# One text for both trees, so that they do not differ by it; each has a page of this name.
HEADER = 'Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md'
COMMENTS = dict.fromkeys(('.cfg', '.msg', '.py', '.rviz', '.srv', '.yaml'), '# {}')
COMMENTS |= dict.fromkeys(('.html', '.md', '.xml'), '<!-- {} -->') | {'.js': '// {}'}
COMMENTS['.rst'] = '.. {}\n'  # a blank line ends it
FIRST_LINES = re.compile(
    rb'(#!.*\n|#.*(PYTHON_ARGCOMPLETE_OK|coding[:=]).*\n|<\?xml.*\?>\n|<!doctype .*>\n)*', re.IGNORECASE
)
MERGE_HEADS = ('MERGE_HEAD', 'CHERRY_PICK_HEAD', 'REVERT_HEAD', 'REBASE_HEAD')  # one exists during a merge
Rendered = dict[str, tuple[bytes, int]]  # path below the root, with /: content, and mode as git keeps it


class GenerationError(Exception):
    """The table and the core do not match."""


def load_table(path: Path) -> dict:
    """Return the table of the two trees; raises GenerationError if the file is not TOML."""
    try:
        return tomllib.loads(path.read_text(encoding='utf-8'))
    except (OSError, ValueError) as error:
        raise GenerationError(f'{path}: {error}') from error


def render(root: Path, table: dict) -> Rendered:
    """Return every generated file of both trees; reads the core below root, writes nothing."""
    files = _read_core(root)
    rendered: Rendered = {}
    for name, tree in table['trees'].items():
        rendered.update(_render_tree(name, tree, files))
    return rendered


def _render_tree(name: str, tree: dict, files: Rendered) -> Rendered:
    files = _substituted(name, tree, files)
    placed = []
    for core_path, entry in files.items():
        package, slash, rest = core_path.partition('/')
        placed.append((tree.get('folders', {}).get(package, package) + slash + rest, entry))
    for path, (content, _) in placed:
        for word in tree.get('forbidden', []):
            if word.lower() in path.lower() or word.lower().encode() in content.lower():
                raise GenerationError(
                    f'twins.toml, {name}: {word!r} is left over in {path}:'
                    ' add the file, with its number of matches, to a substitution'
                )
    return {f'{tree["root"]}/{path}': (with_header(path, content), mode) for path, (content, mode) in placed}


def header_of(path: str) -> bytes:
    """Return the comment that says that a file is generated; b'' for a type without comments."""
    comment = COMMENTS.get(Path(path).suffix)
    return f'{comment.format(HEADER)}\n'.encode() if comment else b''


def with_header(path: str, content: bytes) -> bytes:
    """Return a file's content with the header, after the lines that must stay first."""
    header = header_of(path)
    if header and header in content:
        raise GenerationError(f'{CORE}: {path}: holds the line of a generated file: remove it')
    first = FIRST_LINES.match(content)[0] if header else b''
    return first + header + content[len(first) :]


def _substituted(name: str, tree: dict, files: Rendered) -> Rendered:
    files = dict(files)
    for substitution in tree.get('substitutions', []):
        find, replace = substitution['find'], substitution['replace']
        if not substitution['matches']:
            raise GenerationError(
                f'twins.toml, {name}: the substitution of {find!r} matches no file: delete it'
            )
        for path, expected in substitution['matches'].items():
            content, mode = files.get(path, (b'', 0))
            found = content.count(find.encode())
            if found != expected or found == 0:
                raise GenerationError(
                    f'twins.toml, {name}: {find!r} must match {pluralized(expected, "time")} in {path},'
                    f' and matches {found}: correct the number there, or the core'
                )
            files[path] = content.replace(find.encode(), replace.encode()), mode
    return files


def _read_core(root: Path) -> Rendered:
    files = {}
    for name in _listed(root, CORE):
        path, core_path = root / name, name.removeprefix(f'{CORE}/')
        if '/' not in core_path:
            continue  # a file at the top, such as a README, describes the core
        if path.is_symlink():
            raise GenerationError(f'{path}: is a symlink: generated trees hold plain files')
        files[core_path] = (path.read_bytes(), _mode(path))
    if not files:
        raise GenerationError(f'{root / CORE}: holds no files')
    return files


def _listed(root: Path, *folders: str) -> list[str]:
    """Return the files below folders of the checkout, without those that git ignores."""
    arguments = ('ls-files', '-z', '--cached', '--others', '--exclude-standard', '--', *folders)
    listed = set(_git(root, *arguments).split('\0')[:-1])
    return sorted(path for path in listed if os.path.lexists(root / path))


def _git(root: Path, *arguments: str, lines: Iterable[str] = ()) -> str:
    """Return what git prints; raises GenerationError with its error message."""
    text = ''.join(f'{line}\n' for line in lines)
    result = subprocess.run(
        ['git', *arguments], cwd=root, input=text, capture_output=True, text=True, check=False
    )
    if result.returncode:
        raise GenerationError(f'{root}: {result.stderr.strip()}')
    return result.stdout


def _mode(path: Path) -> int:
    return 0o755 if path.stat().st_mode & stat.S_IXUSR else 0o644


def compare(root: Path, rendered: Rendered, table: dict) -> list[str]:
    """Return one finding per difference between the trees below root and the rendered files."""
    findings = []
    for path, (content, mode) in rendered.items():
        target = root / path
        if target.is_symlink() or not target.is_file():
            findings.append(f'{path}: missing, or not a plain file')
            continue
        if target.read_bytes() != content:
            diff = _diff(path, target.read_bytes(), content, ('in the tree', 'generated'))
            findings.append(f'{path}: differs from what the core generates\n{diff}')
        if _mode(target) != mode:
            findings.append(f'{path}: has mode {_mode(target):o}, the core {mode:o}')
    findings += [f'{path}: not generated from the core' for path in extras(root, rendered, table)]
    return findings


def extras(root: Path, rendered: Rendered, table: dict) -> list[str]:
    """Return the files of the owned packages that are neither rendered nor ignored by git."""
    packages = [f'{tree["root"]}/{name}' for tree in table['trees'].values() for name in table['owned']]
    return [path for path in _listed(root, *packages) if path not in rendered]


def edited(root: Path, rendered: Rendered) -> list[str]:
    """
    Return the files that somebody has edited: their content was not generated here, and is in no commit.

    Returns none if there is no commit yet, because git cannot tell then. Returns none during a merge, where
    git itself has edited the files.
    """
    changed = [
        path
        for path, (content, _) in rendered.items()
        if not (root / path).is_symlink()
        and (root / path).is_file()
        and (root / path).read_bytes() != content
    ]
    if not changed or not _git(root, 'rev-list', '--max-count=1', '--all'):
        return []
    git_folder = root / _git(root, 'rev-parse', '--git-dir').strip()
    if any((git_folder / head).exists() for head in MERGE_HEADS):
        return []
    unmerged = _git(root, 'diff', '--name-only', '--relative', '-z', '--diff-filter=U').split('\0')
    known = set(_ledger(root).read_text().split()) if _ledger(root).exists() else set()
    known |= set(_git(root, 'ls-tree', '-r', '--format=%(objectname)', 'HEAD').split())
    ids = _git(root, 'hash-object', '--stdin-paths', lines=changed).split()
    in_history = ('log', '--all', '--reflog', '-m', '--max-count=1', '--format=%H')
    return [
        path
        for path, object_id in zip(changed, ids, strict=True)
        if path not in unmerged
        and object_id not in known
        and not _git(root, *in_history, f'--find-object={object_id}')
    ]


def remember(root: Path, rendered: Rendered) -> None:
    """Add the written content to the ledger, so that it does not count as an edit later."""
    ledger = _ledger(root)
    known = set(ledger.read_text().split()) if ledger.exists() else set()
    known |= set(_git(root, 'hash-object', '--stdin-paths', lines=rendered).split())
    ledger.write_text(''.join(f'{object_id}\n' for object_id in sorted(known)))


def _ledger(root: Path) -> Path:
    """Return the file with the git object id of each content that was generated in this checkout."""
    return root / _git(root, 'rev-parse', '--git-path', 'generated_from_core').strip()


def _diff(path: str, before: bytes, after: bytes, names: tuple[str, str]) -> str:
    """Return the diff between two contents of a file, with these names."""
    try:
        lines = [text.decode().splitlines(keepends=True) for text in (before, after)]
    except UnicodeDecodeError:
        return f'{path} (binary: {len(before)} and {len(after)} bytes)\n'
    diff = difflib.unified_diff(*lines, *(f'{path} ({name})' for name in names))
    return ''.join(
        line if line.endswith('\n') else f'{line}\n\\ No newline at end of file\n' for line in diff
    )


def write(root: Path, rendered: Rendered) -> list[str]:
    """Write the rendered files and no others; return the paths that changed."""
    changed = []
    for path, (content, mode) in rendered.items():
        target = root / path
        if target.is_symlink():
            target.unlink()
        if target.is_file() and target.read_bytes() == content and _mode(target) == mode:
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)
        target.chmod(mode)
        changed.append(path)
    return changed


def main(arguments: list[str] | None = None) -> int:
    """Generate, or with --check compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    what = parser.add_mutually_exclusive_group()
    what.add_argument('--check', action='store_true', help='compare only; write nothing')
    what.add_argument('--prune', action='store_true', help='remove files that the core does not render')
    parser.add_argument('--force', action='store_true', help='overwrite edits of generated files')
    parser.add_argument('--root', type=Path, default=ROOT, help='the checkout; default: this one')
    options = parser.parse_args(arguments)
    root = options.root
    try:
        table = load_table(root / 'tools/twins.toml')
        rendered = render(root, table)
        if options.check:
            return _report(compare(root, rendered, table), rendered)
        unknown = extras(root, rendered, table)
        if unknown and not options.prune:
            files = ''.join(f'generate: {path}: is not from the core\n' for path in unknown)
            raise GenerationError(
                f'nothing was written. Move a file of your own into tools/core, or out of the package;'
                f' remove what a rename left behind with: make generate ARGS=--prune\n{files}'.rstrip()
            )
        if (paths := edited(root, rendered)) and not options.force:
            diffs = (
                _diff(path, rendered[path][0], (root / path).read_bytes(), ('generated', 'in the tree'))
                for path in paths
            )
            raise GenerationError(
                'nothing was written. Somebody has edited what is generated. Make this edit in tools/core;'
                f' to drop it: make generate ARGS=--force\n{"".join(diffs)}'.rstrip()
            )
        changed = write(root, rendered)
        for path in unknown:
            (root / path).unlink()
        remember(root, rendered)
    except (GenerationError, OSError) as error:
        print(f'generate: {error}', file=sys.stderr)
        return 2
    print(
        *changed, *(f'{path} (removed)' for path in unknown), sep='\n', end='\n' if changed or unknown else ''
    )
    print(f'{pluralized(len(rendered), "file")} generated, {len(changed)} changed')
    return 0


def _report(findings: list[str], rendered: Rendered) -> int:
    if not findings:
        print(f'{len(rendered)} generated files are what the core generates')
        return 0
    print(*findings, sep='\n')
    counted = pluralized(len(findings), 'finding')
    print(f'{counted}. Edit tools/core, never a generated file; then: make generate')
    return 1


if __name__ == '__main__':
    sys.exit(main())
