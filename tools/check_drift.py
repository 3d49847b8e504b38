"""
Compare the monorepo's bridge with the open-source mirror: only one divergence is allowed.

    python3 check_drift.py --monorepo DIR --mirror DIR [--format text|github|json]

Undoes the rename of the message package, then compares every file of the message and bridge
packages. Knows nothing of how the trees were made. Needs Python 3.10 and nothing else.

Exit code: 0 only the allowed divergence, 1 drift, 2 the trees cannot be compared.
"""

import argparse
import ast
import difflib
import json
import re
import stat
import sys
import unicodedata
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

BRIDGE = 'lupin_greenhouse_bridge'
MSGS = {'monorepo': 'lupin_msgs', 'mirror': 'lupin_greenhouse_msgs'}

# The one allowed divergence: this function of this file returns this.
NODE_FILE = f'{BRIDGE}/{BRIDGE}/bridge_node.py'
SIMULATION_FILE = f'{BRIDGE}/{BRIDGE}/simulation.py'
DIVERGENT_FUNCTION = '_config_path'
DIVERGENT_LINE = {
    'monorepo': '    return Path(value) if value else None',
    'mirror': '    return value or None',
}
PATH_PARAMETERS = ['tag_file', 'sim_config_file']

# Files that one tree has alone; every other file of the mirror has its twin in the monorepo.
OWN_FILES = {
    'monorepo': {f'{MSGS["monorepo"]}/srv/ConfirmTag.srv'},
    'mirror': {
        '.github/ISSUE_TEMPLATE/bug.md',
        '.github/PULL_REQUEST_TEMPLATE.md',
        '.github/workflows/ci.yml',
        '.gitignore',
        'CHANGELOG.rst',
        'COLCON_IGNORE',
        'CONTRIBUTING.md',
        'LICENSE',
        'README.md',
        'rosdep.yaml',
    },
}
# Lines of a shared file that name a file of the monorepo alone.
OWN_LINES = {f'{MSGS["monorepo"]}/CMakeLists.txt': b'  "srv/ConfirmTag.srv"\n'}

NOT_SOURCE = {'.git', '__pycache__', '.pytest_cache', '.hypothesis', '.ruff_cache'}
BUILD_OUTPUT = {'build', 'install', 'log'}  # where colcon was run in a tree or in a package

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
    line: int  # from 1; 1 where the whole file is meant
    message: str
    diff: str = ''


@dataclass(frozen=True)
class Entry:
    """A file of a tree."""

    path: Path
    content: bytes
    is_executable: bool


class Tree:
    """The compared files of one tree, by their name in the monorepo."""

    def __init__(self, name: str, root: Path):
        self.name = name
        self.root = root
        self.symlinks: list[Path] = []
        self.entries: list[Entry] = []
        self.files: dict[str, Entry] = {}
        packages = [MSGS[name], BRIDGE]
        if not root.is_dir():
            raise CannotCompareError(f'{root}: is no folder')
        for package in packages:
            if not (root / package / 'package.xml').is_file():
                raise CannotCompareError(f'{root}: has no package {package}: is it the {name}?')
        for path in self._walk(root if name == 'mirror' else None, packages):
            content = path.read_bytes()
            is_executable = bool(path.stat().st_mode & stat.S_IXUSR)
            entry = Entry(path, content, is_executable)
            self.entries.append(entry)
            self.files[path.relative_to(root).as_posix().replace(MSGS[name], MSGS['monorepo'])] = entry
        if NODE_FILE not in self.files:
            raise CannotCompareError(f'{root}: has no {NODE_FILE}')

    def _walk(self, whole: Path | None, packages: list[str]) -> Iterator[Path]:
        for top in [whole] if whole else [self.root / package for package in packages]:
            for path in sorted(top.rglob('*')):
                parts = path.relative_to(self.root).parts
                place = parts[1:] if parts[0] in packages else parts
                if NOT_SOURCE.intersection(parts) or BUILD_OUTPUT.intersection(place[:1]):
                    continue
                if path.suffix == '.pyc' or any(part.endswith('.egg-info') for part in parts):
                    continue
                if path.is_symlink():
                    self.symlinks.append(path)
                elif path.is_file():
                    yield path

    def undone(self, name: str) -> bytes:
        """Return a file's content with the monorepo's names."""
        return self.files[name].content.replace(MSGS[self.name].encode(), MSGS['monorepo'].encode())


def compare(monorepo: Tree, mirror: Tree) -> list[Finding]:
    """Return every drift between two trees."""
    findings = [
        *_symlinks(monorepo),
        *_symlinks(mirror),
        *_colcon_ignore(monorepo, mirror),
        *_left_over_names(monorepo, MSGS['mirror']),
        *_left_over_names(mirror, MSGS['monorepo']),
        *_one_sided(monorepo, mirror),
        *_one_sided(mirror, monorepo),
    ]
    for name in sorted((monorepo.files.keys() & mirror.files.keys()) - OWN_FILES['monorepo']):
        findings += _modes(name, monorepo, mirror)
        if name == NODE_FILE:
            findings += _bridge_node(monorepo, mirror)
        elif name.endswith(('.msg', '.srv', '.action')):
            findings += _interfaces(name, monorepo, mirror)
        else:
            findings += _contents('package file', name, monorepo, mirror)
    for tree in (monorepo, mirror):
        findings += _divergence_in_place(tree)
        findings += _divergence_not_healed(tree)
    return findings


def _symlinks(tree: Tree) -> Iterator[Finding]:
    for path in tree.symlinks:
        target = path.resolve()
        where = 'out of the tree' if not target.is_relative_to(tree.root.resolve()) else 'inside of it'
        yield Finding('symlink', str(path), 1, f'is a symlink that points {where}: put a plain file there')


def _colcon_ignore(monorepo: Tree, mirror: Tree) -> Iterator[Finding]:
    heading, wanted = 'COLCON_IGNORE', mirror.root / 'COLCON_IGNORE'
    if 'COLCON_IGNORE' not in mirror.files:
        message = 'is missing: without it the clone collides with the bridge in the workspace of the monorepo'
        yield Finding(heading, str(wanted), 1, message)
    elif mirror.files['COLCON_IGNORE'].content:
        yield Finding(heading, str(wanted), 1, 'is not empty: colcon reads only its name, keep it empty')
    if (monorepo.root / 'COLCON_IGNORE').exists():
        message = 'hides the whole monorepo from colcon: delete it'
        yield Finding(heading, str(monorepo.root / 'COLCON_IGNORE'), 1, message)
    for tree in (monorepo, mirror):
        for name, entry in tree.files.items():
            if name.endswith('/COLCON_IGNORE'):
                yield Finding(heading, str(entry.path), 1, 'hides a package from colcon: delete it')


def _left_over_names(tree: Tree, foreign: str) -> Iterator[Finding]:
    """Find the other tree's package name; the mirror's own contains no copy of the monorepo's."""
    own = MSGS[tree.name]
    pattern = re.compile(re.escape(foreign).replace('_', '[_-]'), re.IGNORECASE)
    for entry in tree.entries:
        path = entry.path.relative_to(tree.root).as_posix()
        if pattern.search(path):
            message = f'is named after {foreign}; in the {tree.name} that package is {own}'
            yield Finding('left-over name', str(entry.path), 1, message)
        for number, line in enumerate(entry.content.decode(errors='replace').splitlines(), start=1):
            if pattern.search(line):
                message = f'names {foreign}; in the {tree.name} that package is {own}'
                yield Finding('left-over name', str(entry.path), number, message, f'{line}\n')


def _one_sided(tree: Tree, other: Tree) -> Iterator[Finding]:
    for name in sorted(tree.files.keys() - other.files.keys() - OWN_FILES[tree.name]):
        if not name.endswith('COLCON_IGNORE'):
            message = f'only the {tree.name} has this file, and it is not on its list of own files'
            yield Finding('only one side', str(tree.files[name].path), 1, message)
    for name in sorted(tree.files.keys() & OWN_FILES[other.name] - {'COLCON_IGNORE'}):
        message = f'is for the {other.name} alone'
        yield Finding('only one side', str(tree.files[name].path), 1, message)


def _modes(name: str, monorepo: Tree, mirror: Tree) -> Iterator[Finding]:
    if monorepo.files[name].is_executable != mirror.files[name].is_executable:
        which = 'monorepo' if monorepo.files[name].is_executable else 'mirror'
        yield Finding('file mode', str(mirror.files[name].path), 1, f'is executable in the {which} only')


def _contents(heading: str, name: str, monorepo: Tree, mirror: Tree) -> Iterator[Finding]:
    left, right = monorepo.undone(name), mirror.undone(name)
    own_line = OWN_LINES.get(name)
    if own_line and left.count(own_line) == 1:
        left = left.replace(own_line, b'')
    if left != right:
        yield _difference(heading, name, left, right, monorepo, mirror)


def _difference(heading: str, name: str, left: bytes, right: bytes, monorepo: Tree, mirror: Tree) -> Finding:
    path = str(mirror.files[name].path)
    try:
        texts = left.decode(), right.decode()
    except UnicodeDecodeError:
        return Finding(
            heading,
            path,
            1,
            f'differs, and is no UTF-8 text on at least one side: {len(left)} and {len(right)} bytes',
        )
    reason = _invisible_difference(*texts)
    lines = [text.splitlines(keepends=True) for text in texts]
    line = next(
        (number for number, pair in enumerate(zip(*lines, strict=False), start=1) if pair[0] != pair[1]),
        min(map(len, lines)) + 1,
    )
    message = f'differs in {reason}' if reason else 'differs beyond the rename'
    diff = ''.join(
        _visible(each) for each in difflib.unified_diff(*lines, str(monorepo.files[name].path), path)
    )
    return Finding('invisible difference' if reason else heading, path, max(line, 1), message, diff)


def _invisible_difference(left: str, right: str) -> str:
    """Name the kind of a difference that a reader does not see, or return ''."""
    steps = (
        ('a byte order mark', lambda text: text.removeprefix('\ufeff')),
        ('line endings', lambda text: text.replace('\r\n', '\n').replace('\r', '\n')),
        ('trailing space', lambda text: '\n'.join(line.rstrip() for line in text.split('\n'))),
        ('the end of the last line', lambda text: text.rstrip('\n')),
        ('tabs', lambda text: re.sub(r'[ \t]+', ' ', text) if '\t' in left + right else text),
        ('invisible characters', lambda text: ''.join(c for c in text if unicodedata.category(c) != 'Cf')),
    )
    reasons = []
    for reason, normalise in steps:
        before = left == right
        was_alike = normalise(left) == left and normalise(right) == right
        left, right = normalise(left), normalise(right)
        if not before and not was_alike:
            reasons.append(reason)
        if left == right:
            return ' and '.join(reasons)
    pairs = [(a, b) for a, b in zip(left, right, strict=False) if a != b]
    if len(left) == len(right) and all(not (a.isascii() and b.isascii()) for a, b in pairs):
        return 'look-alike characters: ' + ', '.join(
            f'{_name(a)} and {_name(b)}' for a, b in dict.fromkeys(pairs)
        )
    return ''


def _name(character: str) -> str:
    return f'{unicodedata.name(character, "?")} (U+{ord(character):04X})'


def _visible(line: str) -> str:
    """Return a diff line in which what cannot be seen can be seen."""
    body = line.removesuffix('\n')
    mark, rest = body[:1], body[1:]
    stripped = rest.rstrip(' ')
    shown = ''.join(
        c if c.isascii() and c.isprintable() else c.encode('unicode_escape').decode() for c in stripped
    )
    spaces = '\\x20' * (len(rest) - len(stripped)) if mark in '+-' and stripped else ''
    end = '\n' if line.endswith('\n') else '\n\\ No newline at end of file\n'
    return mark + shown + spaces + end


def _bridge_node(monorepo: Tree, mirror: Tree) -> Iterator[Finding]:
    """Compare the two nodes but for the one line, of which each tree must have its own."""
    stand_in = '    return <the allowed divergence>'
    texts = []
    for tree in (monorepo, mirror):
        text = tree.undone(NODE_FILE).decode(errors='surrogateescape')
        lines = [stand_in if line == DIVERGENT_LINE[tree.name] else line for line in text.split('\n')]
        texts.append('\n'.join(lines).encode(errors='surrogateescape'))
    if texts[0] != texts[1]:
        yield _difference('bridge_node.py', NODE_FILE, *texts, monorepo, mirror)


def _parse(tree: Tree, name: str) -> ast.Module:
    try:
        return ast.parse(tree.files[name].content, filename=str(tree.files[name].path))
    except (SyntaxError, ValueError) as error:
        raise CannotCompareError(f'{tree.files[name].path}: is no Python: {error}') from error


def _divergence_in_place(tree: Tree) -> Iterator[Finding]:
    """Require the tree's own line once, as the whole body of the one function."""
    entry = tree.files[NODE_FILE]
    own, foreign = DIVERGENT_LINE[tree.name], next(DIVERGENT_LINE[n] for n in MSGS if n != tree.name)
    lines = entry.content.decode(errors='replace').splitlines()
    functions = [
        node
        for node in ast.walk(_parse(tree, NODE_FILE))
        if isinstance(node, ast.FunctionDef) and node.name == DIVERGENT_FUNCTION
    ]
    where = [number for number, line in enumerate(lines, start=1) if line == own]
    wrong_way = [number for number, line in enumerate(lines, start=1) if line == foreign]
    heading, path = 'allowed divergence', str(entry.path)
    for number in wrong_way:
        message = f'wrong direction: this line is for the other tree; the {tree.name} has {own.strip()!r}'
        yield Finding(heading, path, number, message, f'{lines[number - 1]}\n')
    if not where:
        if not wrong_way:
            yield Finding(heading, path, 1, f'the line {own.strip()!r} of the {tree.name} is missing')
        return
    for number in where[1:]:
        yield Finding(heading, path, number, f'the line {own.strip()!r} is there more than once')
    if len(functions) != 1:
        message = f'there are {len(functions)} functions {DIVERGENT_FUNCTION}, and one holds the divergence'
        yield Finding(heading, path, where[0], message)
        return
    (function,) = functions
    statements = [node for node in function.body if not _is_docstring(node)]
    if len(statements) != 1 or statements[0].lineno != where[0]:
        message = (
            f'the line {own.strip()!r} is not all that {DIVERGENT_FUNCTION} does: it was moved or added to'
        )
        yield Finding(heading, path, where[0], message)


def _is_docstring(node: ast.stmt) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def _divergence_not_healed(tree: Tree) -> Iterator[Finding]:
    """Require that the path reaches the simulator as the divergent line made it."""
    for name, entry in tree.files.items():
        if not (name.startswith(f'{BRIDGE}/{BRIDGE}/') and name.endswith('.py')):
            continue
        module = _parse(tree, name)
        for line, what in [*_path_constructions(module), *_rebound_paths(module)]:
            text = entry.content.decode(errors='replace').splitlines()[line - 1]
            is_the_line = name == NODE_FILE and text == DIVERGENT_LINE[tree.name]
            if not is_the_line and text not in DIVERGENT_LINE.values():
                message = f'{what}: the divergence of the trees must not be healed in shared code'
                yield Finding('healed divergence', str(entry.path), line, message, f'{text}\n')
    entry = tree.files.get(SIMULATION_FILE)
    calls = _calls(_parse(tree, SIMULATION_FILE), 'GreenhouseSimulator') if entry else []
    handed_on = [
        ast.unparse(ast.Tuple([*call.args, *call.keywords], ast.Load()))
        for call in calls
        if not call.keywords
    ]
    if handed_on != [f'({", ".join(PATH_PARAMETERS)})']:
        message = (
            f'GreenhouseSimulator must be constructed once, from {" and ".join(PATH_PARAMETERS)} as they are'
        )
        path = entry.path if entry else tree.root / SIMULATION_FILE
        yield Finding('healed divergence', str(path), calls[0].lineno if calls else 1, message)
    calls = _calls(_parse(tree, NODE_FILE), 'load')
    wanted = {name: f'{DIVERGENT_FUNCTION}(settings.{name})' for name in PATH_PARAMETERS}
    given = {k.arg: ast.unparse(k.value) for call in calls for k in call.keywords}
    if len(calls) != 1 or given != wanted:
        message = f'both paths must go through {DIVERGENT_FUNCTION} and then to simulation.load, once'
        path = str(tree.files[NODE_FILE].path)
        yield Finding('healed divergence', path, calls[0].lineno if calls else 1, message)


def _calls(module: ast.Module, function: str) -> list[ast.Call]:
    return [
        node
        for node in ast.walk(module)
        if isinstance(node, ast.Call) and ast.unparse(node.func).split('.')[-1] == function
    ]


def _path_constructions(module: ast.Module) -> Iterator[tuple[int, str]]:
    """Find calls of a class of pathlib, under whatever name it was imported."""
    names = {'Path', 'PosixPath', 'PurePath', 'PurePosixPath'}
    for node in ast.walk(module):
        if isinstance(node, ast.ImportFrom) and node.module == 'pathlib':
            names |= {each.asname for each in node.names if each.asname}
    for node in ast.walk(module):
        if isinstance(node, ast.Call) and ast.unparse(node.func).split('.')[-1] in names:
            yield node.lineno, f'{ast.unparse(node)} makes a path'
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
            operands = {each.id for each in ast.walk(node) if isinstance(each, ast.Name)}
            for name in operands.intersection([*PATH_PARAMETERS, 'value']):
                yield node.lineno, f'{ast.unparse(node)} makes a path of {name}'


def _rebound_paths(module: ast.Module) -> Iterator[tuple[int, str]]:
    """Find a function that gives its parameter for a path another value."""
    for function in ast.walk(module):
        if not isinstance(function, ast.FunctionDef):
            continue
        parameters = {each.arg for each in ast.walk(function.args) if isinstance(each, ast.arg)}
        for node in ast.walk(function):
            is_stored = isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
            if is_stored and node.id in parameters.intersection([*PATH_PARAMETERS, 'value']):
                yield node.lineno, f'{node.id} gets another value'


def _interfaces(name: str, monorepo: Tree, mirror: Tree) -> Iterator[Finding]:
    """Compare a .msg, .srv or .action line for line, and say what a difference means."""
    left, right = monorepo.undone(name), mirror.undone(name)
    meanings = [_meaning(tree, name) for tree in (monorepo, mirror)]
    if left == right:
        return
    finding = _difference('interface', name, left, right, monorepo, mirror)
    if meanings[0] != meanings[1]:
        words = [
            f'only the {tree.name} has {", ".join(only)}'
            for tree, mine, other in ((monorepo, *meanings), (mirror, *meanings[::-1]))
            if (only := [each for each in mine if each not in other])
        ] or ['the same fields stand in another order']
        finding = replace(finding, message=f'{finding.message}: {"; ".join(words)}')
    yield finding


FIELD = re.compile(r'(?P<type>[\w/]+(?:<=\d+)?)(?P<array>\[(?:<=)?\d*\])?\s+(?P<name>\w+)\s*(?P<rest>.*)')
SECTIONS = {'.msg': ('message',), '.srv': ('request', 'response'), '.action': ('goal', 'result', 'feedback')}


def _meaning(tree: Tree, name: str) -> list[str]:
    """Return the fields and constants of an interface in order, each with its section."""
    path = tree.files[name].path
    sections = SECTIONS[Path(name).suffix]
    section = 0
    meaning = []
    try:
        text = tree.undone(name).decode()
    except UnicodeDecodeError as error:
        raise CannotCompareError(f'{path}: is no UTF-8 text: {error}') from error
    for number, line in enumerate(text.removeprefix('\ufeff').splitlines(), start=1):
        code = re.sub(r"""("[^"]*"|'[^']*')|#.*""", lambda match: match[1] or '', line).strip()
        if not code:
            continue
        if code == '---':
            section += 1
        elif not (match := FIELD.fullmatch(code)):
            raise CannotCompareError(f'{path}:{number}: is no field, constant or ---: {line.strip()!r}')
        elif section < len(sections):
            kind = 'constant' if match['rest'].startswith('=') else 'field'
            rest = match['rest'].lstrip('= ').strip()
            value = f' = {rest}' if rest else ''
            meaning.append(
                f'{sections[section]} {kind} {match["type"]}{match["array"] or ""} {match["name"]}{value}'
            )
    if section != len(sections) - 1:
        raise CannotCompareError(f'{path}: has {section} lines ---, not {len(sections) - 1}')
    return meaning


def report(findings: list[Finding], compared: int, form: str) -> str:
    """Return the findings as text for people, annotations for GitHub, or JSON for tools."""
    if form == 'json':
        return json.dumps(
            {'files_compared': compared, 'findings': [asdict(each) for each in findings]}, indent=2
        )
    if form == 'github':
        return '\n'.join(
            f'::error file={_escaped(each.path, ",:")},line={each.line}'
            f',title=drift%3A {_escaped(each.heading, ",:")}'
            f'::{_escaped(each.message)}{_escaped(chr(10) + each.diff if each.diff else "")}'
            for each in findings
        )
    if not findings:
        return f'{compared} files compared: only the allowed divergence'
    blocks = [f'{each.path}:{each.line}: [{each.heading}] {each.message}\n{each.diff}' for each in findings]
    return '\n'.join([*blocks, f'{len(findings)} findings in {compared} files compared.', WHAT_TO_DO])


def _escaped(text: str, also: str = '') -> str:
    for character in f'%\r\n{also}':
        text = text.replace(character, f'%{ord(character):02X}')
    return text


def main(arguments: list[str] | None = None) -> int:
    """Compare the two trees of the command line; return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__.strip().splitlines()[0],
        epilog='Exit code: 0 only the allowed divergence, 1 drift, 2 the trees cannot be compared.',
    )
    parser.add_argument('--monorepo', type=Path, required=True, metavar='DIR', help='holds lupin_msgs')
    parser.add_argument(
        '--mirror', type=Path, required=True, metavar='DIR', help='holds lupin_greenhouse_msgs'
    )
    parser.add_argument('--format', choices=('text', 'github', 'json'), default='text', help='default: text')
    options = parser.parse_args(arguments)
    try:
        monorepo, mirror = Tree('monorepo', options.monorepo), Tree('mirror', options.mirror)
        findings = compare(monorepo, mirror)
    except (CannotCompareError, OSError) as error:
        print(f'check_drift: cannot compare: {error}', file=sys.stderr)
        return 2
    text = report(findings, len(monorepo.files.keys() & mirror.files.keys()), options.format)
    if text:
        print(text)
    return 1 if findings else 0


if __name__ == '__main__':
    sys.exit(main())
