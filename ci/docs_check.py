"""
Check the documents: links, shell blocks, parameters, ranges of sensors, ROS graphs, names of tests.

    make docs-check

Every link and anchor must exist. A block of bash or console is preceded by one of these lines:

    <!-- tested by PATH::NAME -->            a test runs it: the file has a function of that name
    <!-- needs WHAT -->                      it cannot run here, and why
    <!-- followed by make WHAT -->           that target runs it

A table with a column `default` is preceded by the class with these parameters:

    <!-- parameters of MODULE.CLASS -->      the table has exactly its parameters, with their defaults; tables
                                             of the same class share them

Every node of the packages needs a table of its parameters. The commands list their options with --help.

A table of `sensor` and `lowest` has the ranges of the installed mdp-greenhouse, of the version that it names:

    <!-- ranges of mdp-greenhouse VERSION -->

A flowchart is a ROS graph. What its lines say of our nodes is in ROS too, and all that our nodes have in ROS
is in some graph. The arrow of a topic is `-->`, of a service `-.->`, of an action `==>`:

    source --> id["/name<br>Type"] --> target

A test that a document names exists: `test_x.py`, `test_x.py::test_y` or `test_y`.
Indented code blocks have no language, so they are refused.
Exit code: 0 no findings, 1 findings, one line each.
"""

import dataclasses
import functools
import importlib
import importlib.metadata
import os
import re
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote

import rclpy
from jobs import end
from lupin_greenhouse_bridge.errors import pluralized
from lupin_greenhouse_bridge.runtime.parameters import default_text
from lupin_greenhouse_bridge.settings import Settings
from lupin_greenhouse_bridge.simulator import simulation
from lupin_greenhouse_bridge.units import unit_of
from rclpy.action import graph as actions
from rclpy.node import Node

ROOT = Path(__file__).resolve().parent.parent
FENCED = re.compile(r'(?:^<!-- ([^\n]+?) -->\n)?^```(\S*)\n(.*?)^```$', re.MULTILINE | re.DOTALL)
TABLE = re.compile(r'(?:^<!-- (.+?) -->\n)?^(\|.*)\n^\|[-|]+\n((?:^\|.*\n)+)', re.MULTILINE)
LINK = re.compile(r'\[[^\[\]]*\]\(([^)\s]+)\)')
SOURCE = re.compile(r'\bsrc(?:set)?="([^"]+)"')  # of a <picture>
INDENTED = re.compile(r'(?:^|\n)\n(    \S.*)')
NAMED_TEST = re.compile(r'`(test_\w+\.py)?(?:::)?(test_\w+)?`')
GRAPH_LINE = re.compile(r'    (\w+).* (-->|-\.->|==>) \w+\["(\S+)<br>(\w+)"\] \2 (\w+.*)')
NODES = {
    'greenhouse_bridge': 'lupin_greenhouse_bridge.bridge_node.GreenhouseBridgeNode',
    'read_on_sight': 'lupin_greenhouse_bridge.reading.read_on_sight.ReadOnSightNode',
    'record_readings': 'lupin_greenhouse_bridge.recording.record_readings.RecordReadingsNode',
    'show_readings': 'lupin_greenhouse_bridge.display.show_readings.ShowReadingsNode',
    'confirm_tag': 'lupin_tag_confirmation.confirm_tag.ConfirmTagNode',
    'mission_orchestrator': 'lupin_mission.mission_orchestrator.MissionNode',
}
OF_EVERY_NODE = ('rcl_interfaces', 'type_description_interfaces')
PARAMETERS, RANGES = r'\| \w+ \| default \|', r'\| sensor \| lowest \|'


class Block(NamedTuple):
    """A fenced block; `mark` is the text of the comment above it, or ''."""

    mark: str
    language: str
    text: str


class End(NamedTuple):
    """What a node has of a topic, a service or an action; as text, the line of a graph."""

    node: str
    is_target: bool  # it subscribes or serves
    arrow: str
    name: str
    message: str

    def __str__(self) -> str:
        source, target = ('other', self.node) if self.is_target else (self.node, 'other')
        return f'{source} {self.arrow} id["{self.name}<br>{self.message}"] {self.arrow} {target}'


class Document:
    """A Markdown file; `path` is relative to `root`, the folder of the repository."""

    def __init__(self, root: Path, path: Path):
        self.root, self.path = root, path
        self.text = (root / path).read_text(encoding='utf-8')
        self.unfenced = FENCED.sub('', self.text)

    def shell_blocks(self) -> list[Block]:
        """Return each block of commands."""
        blocks = [Block(*found) for found in FENCED.findall(self.text)]
        return [block for block in blocks if block.language in ('bash', 'console', 'sh')]

    def graph_lines(self) -> Iterator[str]:
        """Yield the lines of the ROS graphs, which are flowcharts."""
        for _, _, text in FENCED.findall(self.text):
            _, _, lines = text.partition('flowchart ')
            yield from lines.splitlines()[1:]

    def tables(self, head: str) -> list[tuple[str, list[str]]]:
        """Return each table whose first line matches a pattern: its mark, as of a block, and its rows."""
        found = TABLE.findall(self.text)
        return [(mark, rows.splitlines()) for mark, first, rows in found if re.match(head, first)]

    def anchors(self) -> set[str]:
        """Return the anchors that GitHub gives to the headings."""
        headings = re.findall(r'^#+ (.+)$', self.unfenced, re.MULTILINE)
        return {re.sub(r'[^\w\- ]', '', heading.lower()).replace(' ', '-') for heading in headings}


def cells_of(row: str) -> list[str]:
    """Return the cells of a row, without the code marks around them."""
    return [cell.strip(' `') for cell in row.strip('|').split('|')]


def files_in_git(root: Path, pattern: str) -> list[Path]:
    """Return the files in git whose paths match a pattern, relative to the root."""
    listed = subprocess.run(
        ['git', 'ls-files', pattern], cwd=root, capture_output=True, text=True, check=True
    )
    return [Path(line) for line in listed.stdout.splitlines()]


def broken_links(document: Document) -> Iterator[str]:
    """Yield a finding for each link to a missing file or anchor."""
    for link in LINK.findall(document.unfenced) + SOURCE.findall(document.unfenced):
        if re.match(r'[a-z]+:', link):
            continue
        name, _, anchor = unquote(link).partition('#')
        target = document.path.parent / name if name else document.path
        if not (document.root / target).exists():
            yield f'the link {link} leads nowhere'
        elif anchor and anchor not in Document(document.root, target).anchors():
            yield f'the link {link} names no heading of {os.path.normpath(target)}'


def unproved_blocks(document: Document) -> Iterator[str]:
    """Yield a finding for each block that nothing runs and that gives no reason."""
    for indented in INDENTED.findall(document.unfenced):
        yield f'fence this block and set its language: {indented.strip()[:60]}'
    for mark, _, commands in document.shell_blocks():
        shown = commands.strip().splitlines()[0][:60]
        if mark.startswith('tested by '):
            file, _, name = mark.removeprefix('tested by ').partition('::')
            path = document.root / file
            if not path.is_file() or f'def {name}(' not in path.read_text(encoding='utf-8'):
                yield f'there is no test {file}::{name} for: {shown}'
        elif not mark.startswith(('needs ', 'followed by make ')):
            yield f'mark this block with tested by, needs or followed by: {shown}'


def wrong_rows(name: str, written: list[str], right: list[str]) -> Iterator[str]:
    """Yield a finding for each row that the table of this name lacks, or should not have."""
    yield from (f'the table of {name} lacks the row {row}' for row in right if row not in written)
    yield from (f'the table of {name} has a wrong row {row}' for row in written if row not in right)


def wrong_parameters(document: Document) -> Iterator[str]:
    """Yield a finding for each parameter that a table lacks, invents, or gives another default."""
    rows_of: dict[str, list[str]] = {}
    for mark, rows in document.tables(PARAMETERS):
        kind, _, settings = mark.rpartition(' ')
        if kind == 'parameters of':
            rows_of.setdefault(settings, []).extend(rows)
        else:
            yield f'mark this table with `parameters of`: {rows[0][:60]}'
    for settings, rows in rows_of.items():
        module, _, name = settings.rpartition('.')
        parameters = dataclasses.fields(getattr(importlib.import_module(module), name))
        right = [f'| {each.name} | {default_text(each) or "empty"} |' for each in parameters]
        written = ['| {} | {} |'.format(*cells_of(row)).replace("''", 'empty') for row in rows]
        yield from wrong_rows(settings, written, right)


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


def wrong_ranges(document: Document) -> Iterator[str]:
    """Yield a finding for each row that the installed simulator does not have, and for another version."""
    mark = f'ranges of mdp-greenhouse {importlib.metadata.version("mdp-greenhouse")}'
    for written_mark, rows in document.tables(RANGES):
        if written_mark != mark:
            yield f'mark the ranges with `{mark}`, which is installed'
        yield from wrong_rows('the ranges', rows, sensor_ranges())


def ends_in_line(line: str) -> Iterator[End]:
    """Yield what our nodes have, as a line of a graph says; nothing for a line of another form."""
    if written := GRAPH_LINE.fullmatch(line):
        source, arrow, names, message, targets = written.groups()
        nodes = {source: False} | dict.fromkeys(re.findall(r'(?:^|& )(\w+)', targets), True)
        for name in names.replace('/<br>', '/').split('<br>'):
            yield from (End(node, nodes[node], arrow, name, message) for node in nodes.keys() & NODES)


@functools.cache
def ends_in_ros(name: str) -> set[End]:
    """Create one of our nodes; return what it has in ROS, without what every node has."""
    ends = set()
    module, _, class_name = NODES[name].rpartition('.')
    with tempfile.TemporaryDirectory() as folder:
        parameters = f'-p file:={folder}/readings.sqlite -p require_visual_confirmation:=true'
        rclpy.init(args=['--ros-args', '--log-level', 'error', *parameters.split()])
        node = getattr(importlib.import_module(module), class_name)()
        for arrow, is_target, entries_of in (
            ('-->', False, Node.get_publisher_names_and_types_by_node),
            ('-->', True, Node.get_subscriber_names_and_types_by_node),
            ('-.->', False, Node.get_client_names_and_types_by_node),
            ('-.->', True, Node.get_service_names_and_types_by_node),
            ('==>', False, actions.get_action_client_names_and_types_by_node),
            ('==>', True, actions.get_action_server_names_and_types_by_node),
        ):
            for entry, (kind, *_) in entries_of(node, name, '/'):
                package, _, message = kind.split('/')
                if package not in OF_EVERY_NODE and '/_action/' not in entry:
                    ends.add(End(name, is_target, arrow, entry, message))
        node.destroy_node()
        rclpy.shutdown()
    return ends


def wrong_graphs(document: Document) -> Iterator[str]:
    """Yield a finding for each line of a graph that has another form, or that is not in ROS."""
    for line in document.graph_lines():
        if not GRAPH_LINE.fullmatch(line):
            yield f'write this line of a graph as `source --> id["/name<br>Type"] --> target`: {line.strip()}'
        for node in [each.node for each in ends_in_line(line) if each not in ends_in_ros(each.node)]:
            yield f'{node} does not have this in ROS: {line.strip()}'


def undrawn_ends(documents: list[Document]) -> Iterator[str]:
    """Yield a finding for each topic, service and action of our nodes that is in no graph."""
    drawn = {each for document in documents for line in document.graph_lines() for each in ends_in_line(line)}
    for name in NODES:
        yield from (f'no graph has the line: {each}' for each in sorted(ends_in_ros(name) - drawn))


def missing_tests(document: Document) -> Iterator[str]:
    """Yield a finding for each test that the document names and that does not exist."""
    tests = [document.root / path for path in files_in_git(document.root, '*test_*')]
    for file, function in NAMED_TEST.findall(document.text):
        of_file = [test for test in tests if file in ('', test.name)]
        is_defined = any(f'def {function}(' in test.read_text(encoding='utf-8') for test in of_file)
        is_script = not file and function in {test.name for test in tests}
        if not (is_defined if function else of_file) and not is_script:
            yield f'there is no test {"::".join(filter(None, (file, function)))}'


def undocumented_nodes(documents: list[Document]) -> Iterator[str]:
    """Yield a finding for each node of the packages without a table of its parameters."""
    marks = {mark for document in documents for mark, _ in document.tables(PARAMETERS)}
    for command in importlib.metadata.entry_points(group='console_scripts'):
        if command.module.startswith('lupin_'):
            module = importlib.import_module(command.load().args[0])
            settings = getattr(module, 'Settings', None)
            if settings and f'parameters of {settings.__module__}.{settings.__name__}' not in marks:
                yield f'no document has a table of the parameters of {command.name}'


def findings_of(document: Document) -> list[str]:
    """Return what is wrong in one document, a line each."""
    checks = (broken_links, unproved_blocks, wrong_parameters, wrong_ranges, wrong_graphs, missing_tests)
    return [f'{document.path}: {finding}' for check in checks for finding in check(document)]


def main(root: Path = ROOT) -> int:
    """Check every document; return the exit code."""
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'OFF'  # no other node of the same name
    documents = [Document(root, path) for path in files_in_git(root, '*.md')]
    findings = [finding for document in documents for finding in findings_of(document)]
    findings += [*undocumented_nodes(documents), *undrawn_ends(documents)]
    for finding in findings:
        print(f'docs: {finding}')
    blocks = sum(len(document.shell_blocks()) for document in documents)
    print(f'{len(documents)} documents, {blocks} shell blocks: {pluralized(len(findings), "finding")}')
    return int(bool(findings))


if __name__ == '__main__':
    end(main, 'docs')
