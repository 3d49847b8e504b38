"""
Compare the monorepo's bridge with the open-source mirror: only one divergence is allowed.

    python3 check_drift.py --monorepo DIR --mirror DIR

Undoes the rename of the message package, then compares every file of the bridge package and the three
interfaces of the contract. Does not depend on how the trees were made. Needs only Python 3.10; in a clone,
it asks git which files are tracked.
Exit code: 0 only the allowed divergence, 1 drift, 2 the trees cannot be compared.
"""

import argparse
import ast
import difflib
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

BRIDGE = 'lupin_greenhouse_bridge'
MSGS = {'monorepo': 'lupin_msgs', 'mirror': 'lupin_greenhouse_msgs'}
INTERFACES = 'msg/SensorReading.msg|msg/TagReading.msg|srv/GetTagReading.srv'

# The one allowed divergence: this function of this file only returns this, on a line of its own.
NODE_FILE = f'{BRIDGE}/{BRIDGE}/bridge_node.py'
DIVERGENT_FUNCTION = '_config_path'
DIVERGENT_VALUE = {'monorepo': 'Path(value) if value else None', 'mirror': 'value or None'}
UNDONE = '    return <the allowed divergence>'

# Files of the mirror that are kept by hand, with the monorepo's names; every other file has its twin.
MIRROR_ALONE = {
    '.github/ISSUE_TEMPLATE/bug.md', '.github/PULL_REQUEST_TEMPLATE.md', '.github/distro.sh',
    '.github/workflows/ci.yml',
    '.gitattributes', '.gitignore', 'CHANGELOG.rst', 'COLCON_IGNORE', 'CONTRIBUTING.md',
    'LICENSE', 'README.md', 'custom_tag_file.patch', 'lupin_msgs/CHANGELOG.rst',
    'lupin_msgs/CMakeLists.txt', 'lupin_msgs/package.xml', 'pixi.toml', 'rosdep.yaml',
}  # fmt: skip

HIDES_FROM_COLCON = '(AMENT|CATKIN|COLCON)_IGNORE'
# What is compared of each tree, with the folders that could be symlinks.
COMPARED = {
    'monorepo': rf'{BRIDGE}(/.*)?|lupin_msgs(/msg|/srv|/({INTERFACES}))?|(lupin_msgs/)?{HIDES_FROM_COLCON}',
    'mirror': '.*',
}
# Files that tools leave in a checkout, such as the lock .#a.py. They are compared only if git tracks them.
LEFT_BY_TOOLS = re.compile(
    r'(lupin_\w+/)?(build|install|log)/.*|(.*/)?([^/]+\.(pyc|swp)|[^/]*~|\.#[^/]*|\.DS_Store|pixi\.lock)'
    r'|(.*/)?(\.(git|hypothesis|idea|mypy_cache|pixi|pytest_cache|ruff_cache|venv|vscode)|__pycache__)(/.*)?'
    r'|(.*/)?[^/]+\.egg-info/.*'
)

WHAT_TO_DO = """\
If somebody edited one tree, make the change once, in tools/core of the monorepo's repository, run
`make generate`, and commit the core with both trees. A patch to the mirror goes the same way.
If `make generate-check` finds nothing, the trees differ because of tools/twins.toml: apart from the rename
of the message package, it may replace only the one allowed line."""


class Finding(NamedTuple):
    """One way in which the trees drifted apart."""

    heading: str
    path: Path  # as on the command line, joined with the path below it
    message: str
    line: int = 1
    diff: str = ''


class Tree:
    """The compared files of one tree, by their name in the monorepo."""

    def __init__(self, name: str, root: Path):
        """List the files; raises OSError."""
        self.name = name
        self.root = root
        for needed in (MSGS[name], NODE_FILE):
            if not (root / needed).exists():
                raise FileNotFoundError(f'{root}: has no {needed}: is it the {name}?')
        tracked = tracked_files(root)
        self.files: dict[str, Path] = {}
        self.symlinks: list[Path] = []
        for path in sorted(root.rglob('*')):  # which follows no symlinks
            own_name = path.relative_to(root).as_posix()
            is_wanted = own_name in tracked or not LEFT_BY_TOOLS.fullmatch(own_name)
            if not is_wanted or not re.fullmatch(COMPARED[name], own_name):
                continue
            if path.is_symlink():
                self.symlinks.append(path)
            elif path.is_file():
                self.files[own_name.replace(MSGS[name], MSGS['monorepo'])] = path

    def text(self, name: str) -> str:
        """Return a file as text; raises OSError."""
        return self.files[name].read_bytes().decode(errors='surrogateescape')

    def shared_text(self, name: str) -> str:
        """Return what must be equal in both trees: a file without rename and divergence. Raises OSError."""
        text = self.text(name).replace(MSGS[self.name], MSGS['monorepo'])
        number = divergent_line(text) if name == NODE_FILE else 0
        lines = text.split('\n')
        if number and lines[number - 1] == f'    return {DIVERGENT_VALUE[self.name]}':
            lines[number - 1] = UNDONE
        return '\n'.join(lines)


def divergent_line(text: str) -> int:
    """
    Return the number of the line where the function returns the divergent value; 0 if it is not plain.

    Plain is one that the module binds once, without a decorator, and that has only a docstring and a return.
    """
    try:
        module = ast.parse(text)
    except (SyntaxError, ValueError):  # ValueError: null bytes, or not UTF-8
        return 0
    match [node for node in ast.walk(module) if DIVERGENT_FUNCTION in names_in(node)]:
        case [
            ast.FunctionDef(
                decorator_list=[],
                body=[ast.Return() as end] | [ast.Expr(ast.Constant()), ast.Return() as end],
            ) as function
        ] if function in module.body:
            return end.lineno
    return 0


def names_in(node: ast.AST) -> set[str]:
    """Return the names that a node of the syntax tree may bind, without those that it only reads."""
    if isinstance(getattr(node, 'ctx', None), ast.Load):
        return set()
    return {value for _, value in ast.iter_fields(node) if isinstance(value, str)}


def tracked_files(root: Path) -> set[str]:
    """Return the files that git tracks in a folder; none without git or outside a clone. Raises OSError."""
    command, environment = ['git', 'ls-files', '-z'], {**os.environ, 'LC_ALL': 'C'}
    try:
        result = subprocess.run(command, cwd=root, env=environment, capture_output=True, check=False)
    except FileNotFoundError:
        return set()
    if result.returncode and b'not a git repository' not in result.stderr:
        raise OSError(f'{root}: {result.stderr.decode(errors="replace").strip()}')
    return set(os.fsdecode(result.stdout).split('\0'))


def compare(monorepo: Tree, mirror: Tree) -> Iterator[Finding]:
    """Yield every drift between two trees. Raises OSError."""
    for path in [*monorepo.symlinks, *mirror.symlinks]:
        yield Finding('symlink', path, f'is a symlink to {path.readlink()}: put a plain file or folder there')
    for path in [*monorepo.files.values(), *mirror.files.values()]:
        is_allowed = path == mirror.root / 'COLCON_IGNORE' and not path.read_bytes()
        if re.fullmatch(HIDES_FROM_COLCON, path.name) and not is_allowed:
            message = 'hides packages from colcon; only an empty COLCON_IGNORE at the root of the mirror may'
            yield Finding('COLCON_IGNORE', path, message)
    for name in sorted(MIRROR_ALONE - mirror.files.keys()):
        path = mirror.root / name.replace(MSGS['monorepo'], MSGS['mirror'])
        yield Finding('missing', path, 'is missing; the mirror keeps it by hand: put it back')
    for tree, other in ((monorepo, mirror), (mirror, monorepo)):
        for name, path in tree.files.items():
            yield from _left_over_names(tree, name, MSGS[other.name])
            if name not in other.files.keys() | MIRROR_ALONE:
                message = f'only the {tree.name} has this file, and it is not on the list of own files'
                yield Finding('only one side', path, message)
    for name in sorted(monorepo.files.keys() & mirror.files.keys()):
        yield from _difference(name, monorepo, mirror)


def _left_over_names(tree: Tree, name: str, foreign: str) -> Iterator[Finding]:
    """Find the other tree's package name in a file; the mirror's own contains no copy of the monorepo's."""
    lines = [tree.files[name].relative_to(tree.root).as_posix(), *tree.text(name).splitlines()]
    for number, line in enumerate(lines):
        if re.search(foreign.replace('_', '[_-]'), line, re.IGNORECASE):
            message = f'names {foreign}; in the {tree.name} that package is {MSGS[tree.name]}'
            yield Finding('left-over name', tree.files[name], message, max(number, 1))


def _difference(name: str, monorepo: Tree, mirror: Tree) -> Iterator[Finding]:
    """Compare a file. In bridge_node.py, each tree must have its own form of the one line."""
    trees, path = (monorepo, mirror), mirror.files[name]
    executable = [tree.name for tree in trees if os.access(tree.files[name], os.X_OK)]
    if len(executable) == 1:
        yield Finding('file mode', path, f'is executable in the {executable[0]} only')
    texts = [tree.shared_text(name) for tree in trees]
    heading = 'interface' if name.endswith(('.msg', '.srv')) else 'package file'
    if name == NODE_FILE:
        heading = 'bridge_node.py'
        for tree, text in zip(trees, texts, strict=True):
            if UNDONE not in text.split('\n'):
                message = (
                    f'must have {DIVERGENT_FUNCTION} once, and only: return {DIVERGENT_VALUE[tree.name]}'
                )
                yield Finding('allowed divergence', tree.files[name], message)
    # ascii() shows what a person cannot see: trailing spaces, line endings, look-alike letters.
    ours, theirs = ([ascii(line) for line in text.splitlines(keepends=True)] for text in texts)
    if ours != theirs:
        same = [our == their for our, their in zip(ours, theirs, strict=False)]
        diff = difflib.unified_diff(ours, theirs, str(monorepo.files[name]), str(path), lineterm='')
        text = ''.join(f'{line}\n' for line in diff)
        yield Finding(heading, path, 'differs beyond the rename', [*same, False].index(False) + 1, text)


def pluralized(count: int, thing: str) -> str:
    """Return a count with its noun, such as 1 file or 29 files."""
    return f'{count} {thing}' if count == 1 else f'{count} {thing}s'


def main(arguments: list[str] | None = None) -> int:
    """Compare the two trees of the command line, and print the findings; return the exit code."""
    summary, *_, exit_codes = __doc__.strip().splitlines()
    parser = argparse.ArgumentParser(allow_abbrev=False, description=summary, epilog=exit_codes)
    for name, package in MSGS.items():
        parser.add_argument(f'--{name}', type=Path, required=True, metavar='DIR', help=f'holds {package}')
    options = parser.parse_args(arguments)
    try:
        monorepo, mirror = Tree('monorepo', options.monorepo), Tree('mirror', options.mirror)
        findings = list(compare(monorepo, mirror))
    except OSError as error:
        print(f'check_drift: cannot compare: {error}', file=sys.stderr)
        return 2
    for found in findings:
        print(f'{found.path}:{found.line}: [{found.heading}] {found.message}\n{found.diff}')
    compared = f'{pluralized(len(monorepo.files.keys() & mirror.files.keys()), "file")} compared'
    if not findings:
        print(f'{compared}: only the allowed divergence')
        return 0
    print(f'{pluralized(len(findings), "finding")} in {compared}.\n{WHAT_TO_DO}')
    return 1


if __name__ == '__main__':
    sys.exit(main())
