"""
Write the monorepo's and the mirror's packages from the shared core (tools/core, tools/twins.toml).

    python3 tools/generate.py            write what the core renders, and nothing else
    python3 tools/generate.py --check    compare only; write nothing
    python3 tools/generate.py --prune    write, and remove what the core does not render (after a rename)

Exit code: 0 the trees are what the core generates, 1 (--check) they are not, 2 nothing was written: the
table or the core is wrong, or a package that the core owns holds a file that is not from the core.
"""

import argparse
import difflib
import os
import stat
import subprocess
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
CORE = 'tools/core'
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
    return {f'{tree["root"]}/{path}': entry for path, entry in placed}


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
                    f'twins.toml, {name}: {find!r} must match {expected} times in {path},'
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
    command = ['git', 'ls-files', '-z', '--cached', '--others', '--exclude-standard', '--', *folders]
    listed = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    if listed.returncode:
        raise GenerationError(f'{root}: {listed.stderr.strip()}')
    return sorted(path for path in set(listed.stdout.split('\0')[:-1]) if os.path.lexists(root / path))


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
            findings.append(
                f'{path}: differs from what the core generates\n{_diff(path, target.read_bytes(), content)}'
            )
        if _mode(target) != mode:
            findings.append(f'{path}: has mode {_mode(target):o}, the core {mode:o}')
    findings += [f'{path}: not generated from the core' for path in extras(root, rendered, table)]
    for tree in table['trees'].values():
        for path in tree.get('beside', []):
            if not (root / tree['root'] / path).is_file():
                findings.append(f'{tree["root"]}/{path}: missing (kept by hand, listed in twins.toml)')
    return findings


def extras(root: Path, rendered: Rendered, table: dict) -> list[str]:
    """Return the files of the owned packages that are neither rendered nor ignored by git."""
    packages = [f'{tree["root"]}/{name}' for tree in table['trees'].values() for name in table['owned']]
    return [path for path in _listed(root, *packages) if path not in rendered]


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
        changed = write(root, rendered)
        for path in unknown:
            (root / path).unlink()
    except (GenerationError, OSError) as error:
        print(f'generate: {error}', file=sys.stderr)
        return 2
    print(
        *changed, *(f'{path} (removed)' for path in unknown), sep='\n', end='\n' if changed or unknown else ''
    )
    print(f'{len(rendered)} files generated, {len(changed)} changed')
    return 0


def _report(findings: list[str], rendered: Rendered) -> int:
    if not findings:
        print(f'{len(rendered)} generated files are what the core generates')
        return 0
    print(*findings, sep='\n')
    count = '1 finding' if len(findings) == 1 else f'{len(findings)} findings'
    print(f'{count}. Edit tools/core, never a generated file; then: make generate')
    return 1


if __name__ == '__main__':
    sys.exit(main())
