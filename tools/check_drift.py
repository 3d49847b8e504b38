"""
Compare the monorepo's bridge with the open-source mirror: only one divergence is allowed.

    python3 check_drift.py --monorepo DIR --mirror DIR [--format text|github|json]

Undoes the rename of the message package, then compares every file of the bridge package and the three
interfaces of the contract. Does not depend on how the trees were made. Needs only Python 3.10.
Exit code: 0 only the allowed divergence, 1 drift, 2 the trees cannot be compared.
"""

import argparse
import ast
import difflib
import json
import re
import stat
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
    '.gitignore', '.gitlab-ci.yml', 'CHANGELOG.rst', 'COLCON_IGNORE', 'CONTRIBUTING.md', 'LICENSE',
    'README.md', 'custom_tag_file.patch', 'lupin_msgs/CHANGELOG.rst', 'lupin_msgs/CMakeLists.txt',
    'lupin_msgs/package.xml', 'pixi.toml', 'rosdep.yaml',
}  # fmt: skip

# Files that git, Python and its tools, and colcon leave in a checkout or a package.
LEFT_BY_TOOLS = re.compile(
    r'\.git(/.*)?|(lupin_\w+/)?(build|install|log)/.*|.*\.pyc'
    r'|(.*/)?(__pycache__|\.pytest_cache|\.hypothesis|\.ruff_cache|[^/]+\.egg-info)/.*'
)

WHAT_TO_DO = """\
Both trees are generated. Make the change once, in tools/core of the monorepo's repository, run
`make generate`, and commit the core with both trees. A patch to the mirror goes the same way."""


class CannotCompareError(Exception):
    """There is nothing to compare, or it cannot be read."""


@dataclass(frozen=True)
class Finding:
    """One way in which the trees drifted apart."""

    heading: str
    path: str  # as given on the command line, joined with the path below it
    line: int  # from 1; 1 also stands for the whole file
    message: str
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
        self.symlinks = [path for path in paths if path.is_symlink()]
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
        if self.name == 'monorepo':
            yield from (self.root / MSGS['monorepo'] / interface for interface in INTERFACES)
        for path in sorted((self.root if self.name == 'mirror' else self.root / BRIDGE).rglob('*')):
            if not LEFT_BY_TOOLS.fullmatch(path.relative_to(self.root).as_posix()):
                yield path

    def undone(self, name: str) -> bytes:
        """Return a file's content with the monorepo's names."""
        return self.contents[name].replace(MSGS[self.name].encode(), MSGS['monorepo'].encode())


def compare(monorepo: Tree, mirror: Tree) -> list[Finding]:
    """Return every drift between two trees."""
    findings = [
        *(
            Finding('symlink', str(path), 1, f'is a symlink to {path.readlink()}: put a plain file there')
            for path in monorepo.symlinks + mirror.symlinks
        ),
        *_colcon_ignore(monorepo, mirror),
        *_left_over_names(monorepo, MSGS['mirror']),
        *_left_over_names(mirror, MSGS['monorepo']),
        *_one_sided(monorepo, mirror),
        *_one_sided(mirror, monorepo),
        *_missing(mirror),
    ]
    for name in sorted(monorepo.files.keys() & mirror.files.keys()):
        findings += _modes(name, monorepo, mirror)
        findings += _contents(name, monorepo, mirror)
    return [*findings, *_divergence(monorepo), *_divergence(mirror)]


def _colcon_ignore(monorepo: Tree, mirror: Tree) -> Iterator[Finding]:
    heading, wanted = 'COLCON_IGNORE', mirror.root / 'COLCON_IGNORE'
    if mirror.contents.get('COLCON_IGNORE') != b'':
        message = 'is missing or not empty: an empty one keeps a clone out of the workspace of the monorepo'
        yield Finding(heading, str(wanted), 1, message)
    hiding = [path for tree in (monorepo, mirror) for path in tree.files.values()]
    hiding += [monorepo.root / MSGS['monorepo'] / 'COLCON_IGNORE', monorepo.root / 'COLCON_IGNORE']
    for path in hiding:
        if path.name == 'COLCON_IGNORE' and path != wanted and path.exists():
            yield Finding(heading, str(path), 1, 'hides packages from colcon: delete it')


def _left_over_names(tree: Tree, foreign: str) -> Iterator[Finding]:
    """Find the other tree's package name; the mirror's own contains no copy of the monorepo's."""
    pattern = re.compile(re.escape(foreign).replace('_', '[_-]'), re.IGNORECASE)
    message = f'names {foreign}; in the {tree.name} that package is {MSGS[tree.name]}'
    for name, path in tree.files.items():
        lines = tree.contents[name].decode(errors='replace').splitlines()
        for number, line in [(1, str(path.relative_to(tree.root))), *enumerate(lines, start=1)]:
            if pattern.search(line):
                yield Finding('left-over name', str(path), number, message, f'{line}\n')


def _one_sided(tree: Tree, other: Tree) -> Iterator[Finding]:
    for name in sorted(tree.files.keys() - other.files.keys() - MIRROR_ALONE):
        if not name.endswith('COLCON_IGNORE'):
            message = f'only the {tree.name} has this file, and it is not on the list of own files'
            yield Finding('only one side', str(tree.files[name]), 1, message)


def _missing(mirror: Tree) -> Iterator[Finding]:
    for name in sorted(MIRROR_ALONE - mirror.files.keys() - {'COLCON_IGNORE'}):
        path = mirror.root / name.replace(MSGS['monorepo'], MSGS['mirror'])
        yield Finding('missing', str(path), 1, 'is missing; the mirror keeps it by hand: put it back')


def _modes(name: str, monorepo: Tree, mirror: Tree) -> Iterator[Finding]:
    ours, theirs = (tree.files[name].stat().st_mode & stat.S_IXUSR for tree in (monorepo, mirror))
    if ours != theirs:
        message = f'is executable in the {"monorepo" if ours else "mirror"} only'
        yield Finding('file mode', str(mirror.files[name]), 1, message)


def _contents(name: str, monorepo: Tree, mirror: Tree) -> Iterator[Finding]:
    """Compare a file. In bridge_node.py, each tree must have its own form of the one line."""
    contents = monorepo.undone(name), mirror.undone(name)
    heading, meaning = 'package file', ''
    if name == NODE_FILE:
        heading = 'bridge_node.py'
        contents = tuple(
            content.replace(f'{DIVERGENT_LINE[side]}\n'.encode(), b'    return <the allowed divergence>\n')
            for side, content in zip(MSGS, contents, strict=True)
        )
    elif name.endswith(('.msg', '.srv')):
        heading, meaning = 'interface', _difference_in_meaning(name, monorepo, mirror)
    if contents[0] == contents[1]:
        return
    path = str(mirror.files[name])
    # ascii() shows what a person cannot see: trailing spaces, line endings, look-alike letters.
    lines = [
        [ascii(line) for line in content.decode(errors='surrogateescape').splitlines(keepends=True)]
        for content in contents
    ]
    same = [ours == theirs for ours, theirs in zip(*lines, strict=False)]
    first = same.index(False) + 1 if False in same else len(same) + 1
    diff = difflib.unified_diff(*lines, str(monorepo.files[name]), path, lineterm='')
    message = f'differs beyond the rename{meaning}'
    yield Finding(heading, path, first, message, ''.join(f'{line}\n' for line in diff))


def _divergence(tree: Tree) -> Iterator[Finding]:
    """Require the tree's own line, once, as the whole body of the one function."""
    heading, path = 'allowed divergence', str(tree.files[NODE_FILE])
    own, foreign = DIVERGENT_LINE[tree.name], next(DIVERGENT_LINE[n] for n in MSGS if n != tree.name)
    lines = tree.contents[NODE_FILE].decode(errors='replace').splitlines()
    if foreign in lines:
        message = f'wrong direction: this line is for the other tree; the {tree.name} has {own.strip()!r}'
        yield Finding(heading, path, lines.index(foreign) + 1, message, f'{foreign}\n')
        return
    if lines.count(own) != 1:
        times = pluralized(lines.count(own), 'time')
        message = f'the line {own.strip()!r} of the {tree.name} is there {times}, not once'
        yield Finding(heading, path, 1, message)
        return
    try:
        module = ast.parse(tree.contents[NODE_FILE])
    except (SyntaxError, ValueError) as error:
        raise CannotCompareError(f'{path}: is not Python: {error}') from error
    bodies = [
        [part.lineno for part in node.body if not isinstance(part, ast.Expr)]  # a docstring is an Expr
        for node in ast.walk(module)
        if isinstance(node, ast.FunctionDef) and node.name == DIVERGENT_FUNCTION
    ]
    if bodies != [[lines.index(own) + 1]]:
        message = (
            f'the line {own.strip()!r} is not all that {DIVERGENT_FUNCTION} does: it was moved or added to'
        )
        yield Finding(heading, path, lines.index(own) + 1, message)


def _difference_in_meaning(name: str, monorepo: Tree, mirror: Tree) -> str:
    """Say which fields and constants differ, or return ''."""
    ours, theirs = _meaning(monorepo, name), _meaning(mirror, name)
    words = [f'the monorepo has {field}' for field in ours if field not in theirs]
    words += [f'the mirror has {field}' for field in theirs if field not in ours]
    if ours != theirs and not words:
        words = ['the same fields are in another order']
    return f': {"; ".join(words)}' if words else ''


def _meaning(tree: Tree, name: str) -> list[str]:
    """Return the fields and constants of an interface in order, each with its section."""
    path, sections = tree.files[name], ['message'] if name.endswith('.msg') else ['request', 'response']
    try:
        text = tree.undone(name).decode('utf-8-sig')
    except UnicodeDecodeError as error:
        raise CannotCompareError(f'{path}: is not UTF-8 text: {error}') from error
    # A # starts a comment, except inside a string.
    code = re.sub(r"""("[^"\n]*"|'[^'\n]*')|#.*""", lambda match: match[1] or '', text)
    parts = re.split(r'^---\s*$', code, flags=re.MULTILINE)
    if len(parts) != len(sections):
        raise CannotCompareError(
            f'{path}: has {pluralized(len(parts) - 1, "line")} ---, not {len(sections) - 1}'
        )
    meaning = []
    for section, part in zip(sections, parts, strict=True):
        for line in filter(None, map(str.strip, part.splitlines())):
            if not re.fullmatch(r'[\w/]+(<=\d+)?(\[(<=)?\d*\])?\s+\w+\s*(=?\s*\S.*)?', line):
                raise CannotCompareError(f'{path}: is not a field, constant or ---: {line!r}')
            meaning.append(f'{section} {" ".join(line.replace("=", " = ").split())}')
    return meaning


def report(findings: list[Finding], compared: int, form: str) -> str:
    """Return the findings as text for people, annotations for GitHub, or JSON for tools."""
    if form == 'json':
        counts = {'files_compared': compared, 'findings': [asdict(finding) for finding in findings]}
        return json.dumps(counts, indent=2)
    if form == 'github':
        return '\n'.join(
            f'::error file={_escaped(found.path, ",:")},line={found.line}'
            f',title=drift%3A {_escaped(found.heading, ",:")}'
            f'::{_escaped(found.message)}{_escaped(chr(10) + found.diff if found.diff else "")}'
            for found in findings
        )
    if not findings:
        return f'{pluralized(compared, "file")} compared: only the allowed divergence'
    blocks = [
        f'{found.path}:{found.line}: [{found.heading}] {found.message}\n{found.diff}' for found in findings
    ]
    summary = f'{pluralized(len(findings), "finding")} in {pluralized(compared, "file")} compared.'
    return '\n'.join([*blocks, summary, WHAT_TO_DO])


def pluralized(count: int, thing: str) -> str:
    """Return a count with its noun, such as 1 file or 29 files."""
    return f'{count} {thing}' if count == 1 else f'{count} {thing}s'


def _escaped(text: str, also: str = '') -> str:
    return ''.join(f'%{ord(c):02X}' if c in f'%\r\n{also}' else c for c in text)


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
        findings = compare(monorepo, mirror)
    except (CannotCompareError, OSError) as error:
        print(f'check_drift: cannot compare: {error}', file=sys.stderr)
        return 2
    print(report(findings, len(monorepo.files.keys() & mirror.files.keys()), options.format))
    return int(bool(findings))


if __name__ == '__main__':
    sys.exit(main())
