"""
Check the documents: links, shell blocks, parameters, options, ranges of sensors, names of tests, terms.

    make docs-check

Every link and anchor must exist. A block of bash or console is preceded by one of these lines:

    <!-- run -->                             this script runs it, and it must end with exit code 0
    <!-- tested by PATH::NAME -->            a test runs it: the file has a function of that name
    <!-- needs WHAT -->                      it cannot run here, and why
    <!-- followed by make WHAT -->           that target runs it

A table with a column `default` is preceded by the class with these parameters:

    <!-- parameters of MODULE.CLASS -->      the table has exactly its parameters, with their defaults

A table with a column `option` is preceded by its command, and has a row for each line of its --help:

    <!-- options of COMMAND -->

Every command of the packages needs a table of its options, or a table of its parameters.

A table of `sensor` and `lowest` has the ranges of the installed mdp-greenhouse, of the version that it names:

    <!-- ranges of mdp-greenhouse VERSION -->

A test that a document names exists: `test_x.py`, `test_x.py::test_y` or `test_y`.
A glossary.md has at most 25 terms, of one sentence each. On every page in its folder, and on the pages of the
packages in its tree, the first use of a term links to it, such as [tags](glossary.md#tag).
Indented code blocks have no language, so they are refused.
Exit code: 0 no findings, 1 findings, one line each.
"""

import functools
import importlib
import importlib.metadata
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from urllib.parse import unquote

from lupin_greenhouse_bridge.errors import pluralized
from lupin_greenhouse_bridge.runtime.parameters import launch_arguments
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.simulator import simulation
from lupin_greenhouse_bridge.units import unit_of

ROOT = Path(__file__).resolve().parent.parent
FENCED = re.compile(
    r'(?:^<!-- (?P<mark>[^\n]+?) -->\n)?^```(?P<language>\S*)\n(?P<text>.*?)^```$', re.MULTILINE | re.DOTALL
)
LINK = re.compile(r'\[[^\[\]]*\]\(([^)\s]+)\)')
SOURCE = re.compile(r'\bsrc(?:set)?="([^"]+)"')  # of a <picture>
INDENTED = re.compile(r'(?:^|\n)\n(    \S.*)')
LONGEST_RUN_SECONDS = 300
NAMED_TEST = re.compile(r'`(test_\w+\.py)?(?:::)?(test_\w+)?`')
PARAMETERS = re.compile(
    r'(?:^<!-- parameters of (?P<settings>\S+) -->\n)?^\| \w+ \| default \|.*\n'
    r'^\|[-|]+\n(?P<rows>(?:^\|.*\n)+)',
    re.MULTILINE,
)
RANGES = re.compile(
    r'(?:^<!-- ranges of mdp-greenhouse (?P<version>\S+) -->\n)?^\| sensor \| lowest \|.*\n'
    r'^\|[-|]+\n(?P<rows>(?:^\|.*\n)+)',
    re.MULTILINE,
)
OPTIONS = re.compile(
    r'^<!-- options of (?P<command>\w+) -->\n^\| option \|.*\n^\|[-|]+\n(?P<rows>(?:^\|.*\n)+)', re.MULTILINE
)
LINE_OF_HELP = re.compile(r'^  (\S.*?)(?:  +|\n +)(\S.*)$', re.MULTILINE)
TERM = re.compile(r'^### (.+)\n+((?:.+\n)+)', re.MULTILINE)
MOST_TERMS = 25
NOT_PROSE = re.compile(r'^[#|].*$|^ *<.*>$|`[^`\n]*`', re.MULTILINE)
LINK_TO_TERM = re.compile(r'\[[^\[\]]*\]\((?:\S*/)?glossary\.md#([^)]+)\)')


def documents(root: Path) -> list[Path]:
    """Return every Markdown file in git below the root."""
    listed = subprocess.run(['git', 'ls-files', '*.md'], cwd=root, capture_output=True, text=True, check=True)
    return [Path(line) for line in listed.stdout.splitlines()]


def anchors(text: str) -> set[str]:
    """Return the anchors that GitHub gives to the headings of a document."""
    headings = re.findall(r'^#+ (.+)$', FENCED.sub('', text), re.MULTILINE)
    return {re.sub(r'[^\w\- ]', '', heading.lower()).replace(' ', '-') for heading in headings}


def broken_links(root: Path, path: Path) -> Iterator[str]:
    """Yield a line for each link to a missing file or anchor."""
    text = (root / path).read_text(encoding='utf-8')
    text = FENCED.sub('', text)
    for link in LINK.findall(text) + SOURCE.findall(text):
        if re.match(r'[a-z]+:', link):
            continue
        name, _, anchor = unquote(link).partition('#')
        target = (root / path).parent / name if name else root / path
        if not target.exists():
            yield f'{path}: the link {link} leads nowhere'
        elif anchor and anchor not in anchors(target.read_text(encoding='utf-8')):
            yield f'{path}: the link {link} names no heading of {target.relative_to(root) if name else path}'


def shell_blocks(root: Path, path: Path) -> list[tuple[str, str, str]]:
    """Return (mark, language, commands) of each shell block."""
    text = (root / path).read_text(encoding='utf-8')
    blocks = [(match['mark'] or '', match['language'], match['text']) for match in FENCED.finditer(text)]
    return [block for block in blocks if block[1] in ('bash', 'console', 'sh')]


def unproved_blocks(root: Path, path: Path) -> Iterator[str]:
    """Yield a line for each block that nothing runs and that gives no reason."""
    text = FENCED.sub('', (root / path).read_text(encoding='utf-8'))
    for indented in INDENTED.findall(text):
        yield f'{path}: fence this block and set its language: {indented.strip()[:60]}'
    for mark, _, commands in shell_blocks(root, path):
        shown = commands.strip().splitlines()[0][:60]
        if mark.startswith('tested by '):
            file, _, name = mark.removeprefix('tested by ').partition('::')
            if not (root / file).is_file() or f'def {name}(' not in (root / file).read_text(encoding='utf-8'):
                yield f'{path}: there is no test {file}::{name} for: {shown}'
        elif mark != 'run' and not mark.startswith(('needs ', 'followed by make ')):
            yield f'{path}: mark this block with run, tested by, needs or followed by: {shown}'


def failing_blocks(root: Path, path: Path) -> Iterator[str]:
    """Run the marked blocks; yield a line for each that fails."""
    for mark, _, commands in shell_blocks(root, path):
        if mark != 'run':
            continue
        try:
            result = subprocess.run(
                ['bash', '-eo', 'pipefail', '-c', commands],
                cwd=root,
                capture_output=True,
                text=True,
                timeout=LONGEST_RUN_SECONDS,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            yield f'{path}: {error}'
            continue
        if result.returncode:
            last = (result.stderr or result.stdout).strip().splitlines()[-1:]
            yield f'{path}: exit code {result.returncode} of: {commands.strip()}: {"".join(last)}'


def wrong_defaults(root: Path, path: Path) -> Iterator[str]:
    """Yield a line for each parameter that a table lacks, invents, or gives another default."""
    text = (root / path).read_text(encoding='utf-8')
    for table in PARAMETERS.finditer(text):
        if not table['settings']:
            yield f'{path}: mark this table with `parameters of`: {table["rows"].splitlines()[0][:60]}'
            continue
        module, _, name = table['settings'].rpartition('.')
        settings = getattr(importlib.import_module(module), name)
        real = {name: default for name, default, *_ in launch_arguments(settings)}
        cells = [[cell.strip(' `') for cell in row.split('|')[1:3]] for row in table['rows'].splitlines()]
        written = {name: '' if default in ("''", 'empty') else default for name, default in cells}
        for name in sorted(real.keys() | written.keys()):
            if real.get(name) != written.get(name):
                yield (
                    f'{path}: parameter {name} of {table["settings"]}: the table has {written.get(name)!r},'
                    f' the code has {real.get(name)!r}'
                )


@functools.cache
def sensor_ranges() -> list[str]:
    """Return a row for each sensor: the range at all tags and half hours without noise, unit and noise."""
    greenhouse = simulation.load(Settings(debug_time_of_day=0.0), tag_file=None, sim_config_file=None)
    config = greenhouse.sim.sim_config
    noises = {}
    for name, components in config['sensors'].items():
        noises[name] = max(component['noise_sigma'] for component in components)
        for component in components:
            component['noise_sigma'] = 0.0
    values: dict[str, list[float]] = {name: [] for name in noises}
    for half_hours in range(48):
        config['time']['debug_time_of_day'] = half_hours / 2
        for tag_id in greenhouse.tag_ids:
            for name, value in simulation.read(greenhouse.sim, tag_id)[1].items():
                values[name].append(value)
    return [
        f'| {name} | {min(found):.3g} | {max(found):.3g} | {unit_of(name)} | {noises[name]:g} |'
        for name, found in values.items()
    ]


def wrong_ranges(root: Path, path: Path) -> Iterator[str]:
    """Yield a line for each row that differs from the installed simulator, and for another version of it."""
    for table in RANGES.finditer((root / path).read_text(encoding='utf-8')):
        installed = importlib.metadata.version('mdp-greenhouse')
        if table['version'] != installed:
            yield f'{path}: mark the ranges with `ranges of mdp-greenhouse {installed}`, which is installed'
        written = table['rows'].splitlines()
        for row in sensor_ranges():
            if row not in written:
                yield f'{path}: the ranges lack the row {row}'
        for row in written:
            if row not in sensor_ranges():
                yield f'{path}: the simulator does not have the range {row}'


def missing_tests(root: Path, path: Path) -> Iterator[str]:
    """Yield a line for each test that the document names and that does not exist."""
    listed = subprocess.run(
        ['git', 'ls-files', '*test_*'], cwd=root, capture_output=True, text=True, check=True
    )
    tests = [root / line for line in listed.stdout.splitlines()]
    for file, function in NAMED_TEST.findall((root / path).read_text(encoding='utf-8')):
        of_file = [test for test in tests if file in ('', test.name)]
        defined = any(f'def {function}(' in test.read_text(encoding='utf-8') for test in of_file if function)
        is_script = not file and function in {test.name for test in tests}
        if not (of_file if not function else defined or is_script):
            yield f'{path}: there is no test {file}::{function}'.replace('test ::', 'test ').rstrip(':')


def commands() -> dict[str, Path]:
    """Return the executables of the built packages by name."""
    installed = Path(os.environ['LUPIN_WORKSPACE'], 'install').glob('*/lib/lupin_*/*')
    return {path.name: path for path in sorted(installed) if path.is_file() and os.access(path, os.X_OK)}


@functools.cache
def help_of(command: Path) -> tuple[bool, list[tuple[str, str]]]:
    """Return whether a command has options, and the name and the text of each, or of each parameter."""
    wide = {**os.environ, 'COLUMNS': '1000'}
    text = subprocess.run([command, '--help'], env=wide, capture_output=True, text=True, check=True).stdout
    rows = [
        (re.sub(r'^(-\w) \S+,', r'\1,', name), what.replace('|', r'\|'))  # -o FILE, --output FILE
        for name, what in LINE_OF_HELP.findall(text)
        if not name.startswith('-h')
    ]
    return text.startswith('usage: '), rows


def wrong_options(root: Path, path: Path) -> Iterator[str]:
    """Yield a line for each row that only the table or only the --help of the command has."""
    for table in OPTIONS.finditer((root / path).read_text(encoding='utf-8')):
        name = table['command']
        if name not in commands():
            yield f'{path}: there is no command {name}: options of {name}'
            continue
        written = table['rows'].splitlines()
        rows = [f'| `{option}` | {what} |' for option, what in help_of(commands()[name])[1]]
        yield from (f'{path}: the options of {name} lack the row {row}' for row in rows if row not in written)
        yield from (f'{path}: {name} --help does not have {row}' for row in written if row not in rows)


def undocumented_commands(root: Path, paths: list[Path]) -> Iterator[str]:
    """Yield a line for each command of the packages without a table of its options or parameters."""
    texts = [(root / path).read_text(encoding='utf-8') for path in paths]
    options = {table['command'] for text in texts for table in OPTIONS.finditer(text)}
    tables = [table['rows'] for text in texts for table in PARAMETERS.finditer(text) if table['settings']]
    parameters = [set(re.findall(r'^\| `(\w+)`', rows, re.MULTILINE)) for rows in tables]
    with ThreadPoolExecutor() as threads:
        helps = zip(commands(), threads.map(help_of, commands().values()), strict=True)
        for name, (has_options, rows) in helps:
            if has_options and name not in options:
                yield f'no document has a table with the mark `options of {name}`'
            if not has_options and {parameter.split()[0] for parameter, _ in rows} not in parameters:
                yield f'no document has a table of the parameters of {name}'


def unlinked_terms(root: Path, path: Path) -> Iterator[str]:
    """Yield a line for each term of the tree's glossary that a page uses before it links to the term."""
    places = [path.parent, *(each / 'lupin_greenhouse_bridge/doc' for each in path.parents[1:])]
    glossary = next(
        (root / each / 'glossary.md' for each in places if (root / each / 'glossary.md').exists()), None
    )
    if not glossary or path.parts[1:2] == ('.github',):
        return
    terms = dict(TERM.findall(glossary.read_text(encoding='utf-8')))
    if path.name == glossary.name:
        if len(terms) > MOST_TERMS:
            yield f'{path}: has {len(terms)} terms: keep {MOST_TERMS}'
        for term, text in terms.items():
            if len(re.findall(r'\.(?:\s|$)', text)) != 1:
                yield f'{path}: explain {term} in one sentence'
        return
    text = NOT_PROSE.sub(' ', FENCED.sub('', (root / path).read_text(encoding='utf-8')))
    text = LINK.sub(' ', LINK_TO_TERM.sub('\0\\1\0', text))
    for term in sorted(terms, key=len, reverse=True):  # an approach pose is also a pose
        words = term.replace(' ', r'\s+')
        use = re.compile(rf'(\0{term.replace(" ", "-")}\0)|\b{words}s?\b', re.IGNORECASE)
        first = use.search(text)
        if first and not first[1]:
            where = ' '.join(text[max(first.start() - 20, 0) : first.end() + 20].split())
            yield f'{path}: link the first use of {term} to glossary.md: {where}'
        text = use.sub(' ', text)


CHECKS = (
    broken_links,
    unproved_blocks,
    wrong_defaults,
    wrong_options,
    wrong_ranges,
    missing_tests,
    unlinked_terms,
    failing_blocks,
)


def main(root: Path = ROOT) -> int:
    """Check every document; return the exit code."""
    paths = documents(root)
    findings = [finding for path in paths for check in CHECKS for finding in check(root, path)]
    findings += undocumented_commands(root, paths)
    print(*(f'docs: {finding}' for finding in findings), sep='\n', end='\n' if findings else '')
    blocks = [block for path in paths for block in shell_blocks(root, path)]
    print(f'{len(paths)} documents, {len(blocks)} shell blocks:', pluralized(len(findings), 'finding'))
    return int(bool(findings))


if __name__ == '__main__':
    sys.exit(main())
