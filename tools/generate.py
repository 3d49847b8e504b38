"""
Write the monorepo's and the mirror's packages from the shared core (tools/core, tools/twins.toml).

    python3 tools/generate.py            write both trees
    python3 tools/generate.py --check    compare only; touch nothing

Exit code: 0 the trees are what the core generates, 1 (--check) they are not, 2 the table or the
core is wrong and nothing was written.
"""

import argparse
import difflib
import stat
import sys
from pathlib import Path

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    try:
        import tomli as tomllib
    except ModuleNotFoundError:
        sys.exit('generate: Python 3.10 needs tomli: sudo apt install python3-tomli, or run `make generate`')

ROOT = Path(__file__).resolve().parent.parent
# Left behind by running and testing the packages in place; git ignores them too.
CACHES = {'__pycache__', '.pytest_cache', '.hypothesis', '.ruff_cache'}

Rendered = dict[str, tuple[bytes, int]]  # path below the root, with /: content, and mode as git keeps it


class GenerationError(Exception):
    """The table and the core do not fit together."""


def load_table(path: Path) -> dict:
    """Return the table of the two trees; raises GenerationError on a file that is no table."""
    try:
        return tomllib.loads(path.read_text(encoding='utf-8'))
    except (OSError, ValueError) as error:
        raise GenerationError(f'{path}: {error}') from error


def render(core: Path, table: dict) -> Rendered:
    """Return every generated file of both trees; reads the core, writes nothing."""
    files = _read_tree(core)
    rendered: Rendered = {}
    for name, tree in table.items():
        of_others = {path for other in table if other != name for path in table[other].get('only', [])}
        for path in [*tree.get('only', []), *of_others]:
            if path not in files:
                raise GenerationError(f'twins.toml: {path} is listed under "only", but not in the core')
        own = {path: entry for path, entry in files.items() if path not in of_others}
        rendered.update(_render_tree(name, tree, own))
    return rendered


def _render_tree(name: str, tree: dict, files: Rendered) -> Rendered:
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
                    f'twins.toml, {name}: {find!r} must match {expected} times in {path},'
                    f' and matches {found}: correct the number there, or the core'
                )
            files[path] = content.replace(find.encode(), replace.encode()), mode
    rendered = {}
    folders = tree.get('folders', {})
    for core_path, entry in files.items():
        package, slash, rest = core_path.partition('/')
        path = folders.get(package, package) + slash + rest
        for word in tree.get('forbidden', []):
            if word.lower() in path.lower() or word.lower().encode() in entry[0].lower():
                raise GenerationError(
                    f'twins.toml, {name}: {word!r} is left over in {path}:'
                    ' add the file, with its number of matches, to a substitution'
                )
        rendered[f'{tree["root"]}/{path}'] = entry
    return rendered


def _read_tree(folder: Path) -> Rendered:
    files = {}
    for path in sorted(folder.rglob('*')):
        if CACHES.intersection(path.relative_to(folder).parts):
            continue
        if path.is_symlink():
            raise GenerationError(f'{path}: is a symlink: generated trees hold plain files')
        if path.is_file():
            files[path.relative_to(folder).as_posix()] = (path.read_bytes(), _mode(path))
    if not files:
        raise GenerationError(f'{folder}: holds no files')
    return files


def _mode(path: Path) -> int:
    return 0o755 if path.stat().st_mode & stat.S_IXUSR else 0o644


def compare(root: Path, rendered: Rendered, table: dict) -> list[str]:
    """Return one finding per difference between the trees below root and what was rendered."""
    findings = []
    for path, (content, mode) in rendered.items():
        target = root / path
        if target.is_symlink() or not target.is_file():
            findings.append(f'{path}: missing, or no plain file')
            continue
        if target.read_bytes() != content:
            findings.append(
                f'{path}: differs from what the core generates\n{_diff(path, target.read_bytes(), content)}'
            )
        if _mode(target) != mode:
            findings.append(f'{path}: has mode {_mode(target):o}, the core {mode:o}')
    findings += [f'{path}: not generated from the core' for path in _extras(root, rendered)]
    for tree in table.values():
        for path in tree.get('beside', []):
            if not (root / tree['root'] / path).is_file():
                findings.append(f'{tree["root"]}/{path}: missing (kept by hand, listed in twins.toml)')
    return findings


def _extras(root: Path, rendered: Rendered) -> list[str]:
    """Return the files below a generated package that render() did not make."""
    packages = {'/'.join(path.split('/')[:2]) for path in rendered if path.count('/') > 1}
    return [
        path.relative_to(root).as_posix()
        for package in sorted(packages)
        for path in sorted((root / package).rglob('*'))
        if (path.is_file() or path.is_symlink())
        and path.relative_to(root).as_posix() not in rendered
        and not CACHES.intersection(path.relative_to(root).parts)
    ]


def _diff(path: str, have: bytes, want: bytes) -> str:
    try:
        lines = [text.decode().splitlines(keepends=True) for text in (have, want)]
    except UnicodeDecodeError:
        return f'  (binary: {len(have)} and {len(want)} bytes)'
    diff = difflib.unified_diff(*lines, f'{path} (in the tree)', f'{path} (generated)')
    return ''.join(
        line if line.endswith('\n') else f'{line}\n\\ No newline at end of file\n' for line in diff
    )


def write(root: Path, rendered: Rendered) -> list[str]:
    """Make the trees below root what was rendered; return the paths that changed."""
    changed = []
    for path in _extras(root, rendered):
        (root / path).unlink()
        changed.append(path)
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
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--check', action='store_true', help='compare only; touch nothing')
    parser.add_argument('--root', type=Path, default=ROOT, help='the checkout; default: this one')
    options = parser.parse_args(arguments)
    try:
        table = load_table(options.root / 'tools/twins.toml')
        rendered = render(options.root / 'tools/core', table)
        if not options.check:
            changed = write(options.root, rendered)
            print(*changed, f'{len(rendered)} files generated, {len(changed)} changed', sep='\n')
            return 0
        findings = compare(options.root, rendered, table)
    except (GenerationError, OSError) as error:
        print(f'generate: {error}', file=sys.stderr)
        return 2
    if findings:
        print(*findings, sep='\n')
        print(f'{len(findings)} findings. Edit tools/core, never a generated file; then: make generate')
        return 1
    print(f'{len(rendered)} generated files are what the core generates')
    return 0


if __name__ == '__main__':
    sys.exit(main())
