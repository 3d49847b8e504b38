"""
Compare the monorepo's bridge with the open-source mirror: only one divergence is allowed.

    python3 check_drift.py --monorepo DIR --mirror DIR [--format text|github|json]

Undoes the rename of the message package, then compares every file of the bridge package and the three
interfaces of the contract. Does not depend on how the trees were made. Needs only Python 3.10; in a clone,
it asks git which files are tracked.
Exit code: 0 only the allowed divergence, 1 drift, 2 the trees cannot be compared.
"""

import argparse
import ast
import difflib
import json
import os
import re
import stat
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

BRIDGE = 'lupin_greenhouse_bridge'
MSGS = {'monorepo': 'lupin_msgs', 'mirror': 'lupin_greenhouse_msgs'}
INTERFACES = ('msg/SensorReading.msg', 'msg/TagReading.msg', 'srv/GetTagReading.srv')

# The one allowed divergence: this function of this file only returns this.
NODE_FILE = f'{BRIDGE}/{BRIDGE}/bridge_node.py'
DIVERGENT_FUNCTION = '_config_path'
DIVERGENT_LINE = {
    'monorepo': '    return Path(value) if value else None',
    'mirror': '    return value or None',
}

# Files of the mirror that are kept by hand, with the monorepo's names; every other file has its twin.
MIRROR_ALONE = {
    '.github/ISSUE_TEMPLATE/bug.md', '.github/PULL_REQUEST_TEMPLATE.md', '.github/workflows/ci.yml',
    '.gitattributes', '.gitignore', '.gitlab-ci.yml', 'CHANGELOG.rst', 'COLCON_IGNORE', 'CONTRIBUTING.md',
    'LICENSE', 'README.md', 'custom_tag_file.patch', 'lupin_msgs/CHANGELOG.rst',
    'lupin_msgs/CMakeLists.txt', 'lupin_msgs/package.xml', 'pixi.toml', 'rosdep.yaml',
}  # fmt: skip

IGNORE_MARKERS = {'AMENT_IGNORE', 'CATKIN_IGNORE', 'COLCON_IGNORE'}  # each hides its folder from colcon

# Files that tools leave in a checkout. They are compared only if git tracks them.
LEFT_BY_TOOLS = re.compile(
    r'(lupin_\w+/)?(build|install|log)/.*|(.*/)?([^/]+\.(pyc|swp)|[^/]*~|\.DS_Store|pixi\.lock)'
    r'|(.*/)?(\.(git|hypothesis|idea|mypy_cache|pixi|pytest_cache|ruff_cache|venv|vscode)|__pycache__)(/.*)?'
    r'|(.*/)?[^/]+\.egg-info/.*'
)

WHAT_TO_DO = """\
If somebody edited one tree, make the change once, in tools/core of the monorepo's repository, run
`make generate`, and commit the core with both trees. A patch to the mirror goes the same way.
If `make generate-check` finds nothing, the trees differ because of tools/twins.toml: apart from the rename
of the message package, it may replace only the one allowed line."""


class CannotCompareError(Exception):
    """There is nothing to compare, or it cannot be read."""


@dataclass(frozen=True)
class Finding:
    """One way in which the trees drifted apart."""

    heading: str
    path: Path  # as on the command line, joined with the path below it
    message: str
    line: int = 1
    diff: str = ''


class Tree:
    """The compared files of one tree, by their name in the monorepo."""

    def __init__(self, name: str, root: Path):
        """Read the tree; raises CannotCompareError, OSError."""
        self.name = name
        self.root = root
        if not root.is_dir():
            raise CannotCompareError(f'{root}: is not a folder')
        for package in (MSGS[name], BRIDGE):
            if not (root / package / 'package.xml').is_file():
                raise CannotCompareError(f'{root}: has no package {package}: is it the {name}?')
        paths = [path for path in self._listed() if path.is_symlink() or path.is_file()]
        folders = {folder for path in paths for folder in path.parents if root in folder.parents}
        self.symlinks = sorted(path for path in folders.union(paths) if path.is_symlink())
        self.files = {
            path.relative_to(root).as_posix().replace(MSGS[name], MSGS['monorepo']): path
            for path in paths
            if not path.is_symlink()
        }
        self.contents = {name: path.read_bytes() for name, path in self.files.items()}
        if NODE_FILE not in self.files:
            raise CannotCompareError(f'{root}: has no {NODE_FILE}')

    def _listed(self) -> Iterator[Path]:
        """Yield all paths of the mirror; in the monorepo, those of the bridge and the three interfaces."""
        messages, bridge = self.root / MSGS[self.name], self.root / BRIDGE
        if self.name == 'monorepo':
            yield from (messages / interface for interface in INTERFACES)
        # rglob() follows only the symlink that it starts at, so it starts at each package.
        tops = [self.root, messages, bridge] if self.name == 'mirror' else [bridge]
        tracked = tracked_files(self.root)
        for path in sorted({path for top in tops for path in top.rglob('*')}):
            name = path.relative_to(self.root).as_posix()
            if name in tracked or not LEFT_BY_TOOLS.fullmatch(name):
                yield path

    def undone(self, name: str) -> bytes:
        """Return a file's content with the monorepo's names."""
        return self.contents[name].replace(MSGS[self.name].encode(), MSGS['monorepo'].encode())

    def lines(self, name: str) -> list[str]:
        """Return the lines of a file."""
        return self.contents[name].decode(errors='replace').splitlines()


def tracked_files(root: Path) -> set[str]:
    """Return the files below a folder that git tracks; none without git, or outside a clone."""
    try:
        listed = subprocess.run(['git', 'ls-files', '-z'], cwd=root, capture_output=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return set()
    return set(os.fsdecode(listed).split('\0'))


def compare(monorepo: Tree, mirror: Tree) -> Iterator[Finding]:
    """Yield every drift between two trees; raises CannotCompareError."""
    for path in monorepo.symlinks + mirror.symlinks:
        yield Finding('symlink', path, f'is a symlink to {path.readlink()}: put a plain file or folder there')
    yield from _ignore_markers(monorepo, mirror)
    for tree, other in ((monorepo, mirror), (mirror, monorepo)):
        yield from _left_over_names(tree, MSGS[other.name])
        for name in sorted(tree.files.keys() - other.files.keys() - MIRROR_ALONE):
            if Path(name).name not in IGNORE_MARKERS:
                message = f'only the {tree.name} has this file, and it is not on the list of own files'
                yield Finding('only one side', tree.files[name], message)
    for name in sorted(MIRROR_ALONE - mirror.files.keys() - IGNORE_MARKERS):
        path = mirror.root / name.replace(MSGS['monorepo'], MSGS['mirror'])
        yield Finding('missing', path, 'is missing; the mirror keeps it by hand: put it back')
    for name in sorted(monorepo.files.keys() & mirror.files.keys()):
        yield from _modes(name, monorepo, mirror)
        yield from _contents(name, monorepo, mirror)
    yield from _divergence(monorepo)
    yield from _divergence(mirror)


def _ignore_markers(monorepo: Tree, mirror: Tree) -> Iterator[Finding]:
    wanted = mirror.root / 'COLCON_IGNORE'
    if mirror.contents.get('COLCON_IGNORE') != b'':
        message = 'is missing or not empty: an empty one keeps a clone out of the workspace of the monorepo'
        yield Finding('COLCON_IGNORE', wanted, message)
    not_listed = [
        monorepo.root / folder / marker for folder in ('', MSGS['monorepo']) for marker in IGNORE_MARKERS
    ]
    for path in sorted([*monorepo.files.values(), *mirror.files.values(), *not_listed]):
        if path.name in IGNORE_MARKERS and path != wanted and path.exists():
            yield Finding('COLCON_IGNORE', path, 'hides packages from colcon: delete it')


def _left_over_names(tree: Tree, foreign: str) -> Iterator[Finding]:
    """Find the other tree's package name; the mirror's own contains no copy of the monorepo's."""
    pattern = re.compile(re.escape(foreign).replace('_', '[_-]'), re.IGNORECASE)
    message = f'names {foreign}; in the {tree.name} that package is {MSGS[tree.name]}'
    for name, path in tree.files.items():
        for number, line in [(1, str(path.relative_to(tree.root))), *enumerate(tree.lines(name), start=1)]:
            if pattern.search(line):
                yield Finding('left-over name', path, message, number, f'{line}\n')


def _modes(name: str, monorepo: Tree, mirror: Tree) -> Iterator[Finding]:
    ours, theirs = (tree.files[name].stat().st_mode & stat.S_IXUSR for tree in (monorepo, mirror))
    if ours != theirs:
        message = f'is executable in the {"monorepo" if ours else "mirror"} only'
        yield Finding('file mode', mirror.files[name], message)


def _contents(name: str, monorepo: Tree, mirror: Tree) -> Iterator[Finding]:
    """Compare a file. In bridge_node.py, each tree must have its own form of the one line."""
    contents = [monorepo.undone(name), mirror.undone(name)]
    heading, meaning = 'package file', ''
    if name == NODE_FILE:
        heading = 'bridge_node.py'
        contents = [
            content.replace(f'{DIVERGENT_LINE[side]}\n'.encode(), b'    return <the allowed divergence>\n')
            for side, content in zip(MSGS, contents, strict=True)
        ]
    elif name.endswith(('.msg', '.srv')):
        heading, meaning = 'interface', _difference_in_meaning(*contents)
    if contents[0] == contents[1]:
        return
    # ascii() shows what a person cannot see: trailing spaces, line endings, look-alike letters.
    ours, theirs = (
        [ascii(line) for line in content.decode(errors='surrogateescape').splitlines(keepends=True)]
        for content in contents
    )
    same = [our == their for our, their in zip(ours, theirs, strict=False)]
    first = same.index(False) + 1 if False in same else len(same) + 1
    diff = difflib.unified_diff(ours, theirs, str(monorepo.files[name]), str(mirror.files[name]), lineterm='')
    message = f'differs beyond the rename{meaning}'
    yield Finding(heading, mirror.files[name], message, first, ''.join(f'{line}\n' for line in diff))


def _difference_in_meaning(ours: bytes, theirs: bytes) -> str:
    """Return which fields and constants of an interface differ, or ''."""
    our_fields, their_fields = _fields(ours), _fields(theirs)
    words = [f'the monorepo has {field}' for field in our_fields if field not in their_fields]
    words += [f'the mirror has {field}' for field in their_fields if field not in our_fields]
    if our_fields != their_fields and not words:
        words = ['the same fields are in another order']
    return f': {"; ".join(words)}' if words else ''


def _fields(content: bytes) -> list[str]:
    """Return the fields, constants and --- of an interface in order, without comments and spacing."""
    string_or_comment = re.compile(r"""("[^"\n]*"|'[^'\n]*')|#.*""")
    text = string_or_comment.sub(lambda match: match[1] or '', content.decode(errors='replace'))
    return [' '.join(line.replace('=', ' = ').split()) for line in text.splitlines() if line.strip()]


def _divergence(tree: Tree) -> Iterator[Finding]:
    """Require the tree's own line, once, as the whole body of the one function."""
    heading, path, lines = 'allowed divergence', tree.files[NODE_FILE], tree.lines(NODE_FILE)
    own, foreign = DIVERGENT_LINE[tree.name], next(DIVERGENT_LINE[n] for n in MSGS if n != tree.name)
    try:
        module = ast.parse(tree.contents[NODE_FILE])
    except (SyntaxError, ValueError) as error:
        raise CannotCompareError(f'{path}: is not Python: {error}') from error
    bodies = [
        [ast.unparse(part) for part in node.body if not isinstance(part, ast.Expr)]  # a docstring is an Expr
        for node in ast.walk(module)
        if isinstance(node, ast.FunctionDef) and node.name == DIVERGENT_FUNCTION
    ]
    if foreign in lines:
        message = f'wrong direction: this line is for the other tree; the {tree.name} has {own.strip()!r}'
        yield Finding(heading, path, message, lines.index(foreign) + 1, f'{foreign}\n')
    elif bodies != [[own.strip()]] or lines.count(own) != 1:
        message = f'{own.strip()!r} must be all that {DIVERGENT_FUNCTION} does, and be in this file only once'
        yield Finding(heading, path, message)


def report(findings: list[Finding], compared: int, form: str) -> str:
    """Return the findings as text for people, annotations for GitHub, or JSON for tools."""
    if form == 'json':
        counts = {'files_compared': compared, 'findings': [asdict(finding) for finding in findings]}
        return json.dumps(counts, indent=2, default=str)
    if form == 'github':
        return '\n'.join(map(_annotation, findings))
    if not findings:
        return f'{pluralized(compared, "file")} compared: only the allowed divergence'
    blocks = [
        f'{found.path}:{found.line}: [{found.heading}] {found.message}\n{found.diff}' for found in findings
    ]
    summary = f'{pluralized(len(findings), "finding")} in {pluralized(compared, "file")} compared.'
    return '\n'.join([*blocks, summary, WHAT_TO_DO])


def _annotation(found: Finding) -> str:
    path, heading = _escaped(str(found.path), ',:'), _escaped(found.heading, ',:')
    text = _escaped(f'{found.message}\n{found.diff}'.rstrip('\n'))
    return f'::error file={path},line={found.line},title=drift%3A {heading}::{text}'


def _escaped(text: str, also: str = '') -> str:
    return ''.join(f'%{ord(c):02X}' if c in f'%\r\n{also}' else c for c in text)


def pluralized(count: int, thing: str) -> str:
    """Return a count with its noun, such as 1 file or 29 files."""
    return f'{count} {thing}' if count == 1 else f'{count} {thing}s'


def main(arguments: list[str] | None = None) -> int:
    """Compare the two trees of the command line; return the exit code."""
    summary, *_, exit_codes = __doc__.strip().splitlines()
    parser = argparse.ArgumentParser(description=summary, epilog=exit_codes)
    for name, package in MSGS.items():
        parser.add_argument(f'--{name}', type=Path, required=True, metavar='DIR', help=f'holds {package}')
    parser.add_argument('--format', choices=('text', 'github', 'json'), default='text', help='default: text')
    options = parser.parse_args(arguments)
    try:
        monorepo, mirror = Tree('monorepo', options.monorepo), Tree('mirror', options.mirror)
        findings = list(compare(monorepo, mirror))
    except (CannotCompareError, OSError) as error:
        print(f'check_drift: cannot compare: {error}', file=sys.stderr)
        return 2
    print(report(findings, len(monorepo.files.keys() & mirror.files.keys()), options.format))
    return int(bool(findings))


if __name__ == '__main__':
    sys.exit(main())
