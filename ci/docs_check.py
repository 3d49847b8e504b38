"""
Check the documents: links, shell blocks, parameters, ROS graphs, files of tests.

    make docs-check

Every link and anchor must exist. A block of bash or console is preceded by one of these lines:

    <!-- tested by PATH::NAME -->            a test runs it: the file has a function of that name
    <!-- needs WHAT -->                      it cannot run here, and why
    <!-- followed by make WHAT -->           that target runs it

A table with a column `default` is preceded by the class with these parameters:

    <!-- parameters of MODULE.CLASS -->      the table has only its parameters, with their defaults;
                                             the tables of a class together have all of them

Every node of the packages has such a class. The commands list their options with --help.

A flowchart is a ROS graph. What its lines say of our nodes is in ROS too, and all that our nodes have in ROS
is in some graph. The arrow of a topic is `-->`, of a service `-.->`, of an action `==>`:

    source --> id["/name<br>Type"] --> target

A file of tests that a document names exists.
Indented code blocks have no language, so they are refused.
Exit code: 0 no findings, 1 findings, one line each.
"""

import dataclasses
import importlib
import importlib.metadata
import os
import re
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TypeAlias
from urllib.parse import unquote

import rclpy
from jobs import ROOT, end
from lupin_greenhouse_bridge.errors import pluralized
from lupin_greenhouse_bridge.runtime.parameters import default_text
from rclpy.action import graph as actions
from rclpy.node import Node

Facts: TypeAlias = dict[str, set[str]]  # the rows of each table by its mark, and the ends of the graphs
FENCED = re.compile(r'(?:^<!-- ([^\n]+?) -->\n)?^```(\S*)\n(.*?)^```$', re.MULTILINE | re.DOTALL)
TABLE = re.compile(r'(?:^<!-- (.+?) -->\n)?^\| \w+ \| default \|.*\n^\|[-|]+\n((?:^\|.*\n)+)', re.MULTILINE)
LINK = re.compile(r'\[[^\[\]]*\]\(([^)\s]+)\)|\bsrc(?:set)?="([^"]+)"')  # the latter of a <picture>
INDENTED = re.compile(r'(?:^|\n)\n(    \S.*)')
GRAPH_LINE = re.compile(r'    (\w+).* (-->|-\.->|==>) \w+\["(\S+)<br>(\w+)"\] \2 (\w+.*)')
GRAPHS = 'ROS graphs'
NODES = {
    'greenhouse_bridge': 'lupin_greenhouse_bridge.bridge_node.GreenhouseBridgeNode',
    'read_on_sight': 'lupin_greenhouse_bridge.reading.read_on_sight.ReadOnSightNode',
    'record_readings': 'lupin_greenhouse_bridge.recording.record_readings.RecordReadingsNode',
    'show_readings': 'lupin_greenhouse_bridge.display.show_readings.ShowReadingsNode',
    'confirm_tag': 'lupin_tag_confirmation.confirm_tag.ConfirmTagNode',
    'mission_orchestrator': 'lupin_mission.mission_orchestrator.MissionNode',
}
OF_EVERY_NODE = ('rcl_interfaces', 'type_description_interfaces')


class Document:
    """A Markdown file; `path` is relative to `root`, the folder of the repository."""

    def __init__(self, root: Path, path: Path):
        self.root, self.path = root, path
        self.text = (root / path).read_text(encoding='utf-8')
        self.unfenced = FENCED.sub('', self.text)
        # The text of the comment above each, or '', then its language and its text.
        self.blocks: list[tuple[str, str, str]] = FENCED.findall(self.text)
        self.shell_blocks = [block for block in self.blocks if block[1] in ('bash', 'console', 'sh')]
        graphs = [text.partition('flowchart ')[2] for _, _, text in self.blocks]
        self.graph_lines = [line for graph in graphs for line in graph.splitlines()[1:]]

    def facts(self) -> Facts:
        """Return what the document says of parameters and graphs."""
        said: Facts = {GRAPHS: {each for line in self.graph_lines for each in ends_in(line)}}
        for mark, rows in TABLE.findall(self.text):
            for row in rows.splitlines():
                name, default, *_ = (cell.strip(' `') for cell in row.strip('|').split('|'))
                said.setdefault(mark, set()).add(f'| {name} | {default} |'.replace("''", 'empty'))
        return said

    def anchors(self) -> set[str]:
        """Return the anchors that GitHub gives to the headings."""
        headings = re.findall(r'^#+ (.+)$', self.unfenced, re.MULTILINE)
        return {re.sub(r'[^\w\- ]', '', heading.lower()).replace(' ', '-') for heading in headings}


def files_in_git(root: Path, pattern: str) -> list[Path]:
    """Return the files in git whose paths match a pattern, relative to the root."""
    command = ['git', 'ls-files', pattern]
    listed = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True)
    return [Path(line) for line in listed.stdout.splitlines()]


def broken_links(document: Document) -> Iterator[str]:
    """Yield a finding for each link to a missing file or anchor."""
    for link in map(''.join, LINK.findall(document.unfenced)):
        name, _, anchor = unquote(link).partition('#')
        target = document.path.parent / name if name else document.path
        if re.match(r'[a-z]+:', link):
            continue
        if not (document.root / target).exists():
            yield f'the link {link} leads nowhere'
        elif anchor and anchor not in Document(document.root, target).anchors():
            yield f'the link {link} names no heading of {os.path.normpath(target)}'


def unproved_blocks(document: Document) -> Iterator[str]:
    """Yield a finding for each block that nothing runs and that gives no reason."""
    for indented in INDENTED.findall(document.unfenced):
        yield f'fence this block and set its language: {indented.strip()[:60]}'
    for mark, _, commands in document.shell_blocks:
        shown = commands.strip().splitlines()[0][:60]
        if mark.startswith('tested by '):
            file, _, name = mark.removeprefix('tested by ').partition('::')
            path = document.root / file
            if not path.is_file() or f'def {name}(' not in path.read_text(encoding='utf-8'):
                yield f'there is no test {file}::{name} for: {shown}'
        elif not mark.startswith(('needs ', 'followed by make ')):
            yield f'mark this block with tested by, needs or followed by: {shown}'


def missing_tests(document: Document) -> Iterator[str]:
    """Yield a finding for each file of tests that the document names and that does not exist."""
    tests = {path.name for path in files_in_git(document.root, '*test_*.py')}
    named = re.findall(r'`(test_\w+\.py)`', document.text)
    yield from (f'there is no test {name}' for name in named if name not in tests)


def ends_in(line: str) -> Iterator[str]:
    """Yield what our nodes have, as a line of a graph says; nothing for a line of another form."""
    if written := GRAPH_LINE.fullmatch(line):
        source, arrow, names, message, targets = written.groups()
        for name in names.replace('/<br>', '/').split('<br>'):
            if source in NODES:
                yield f'{source} {arrow} {name} {message}'
            for target in NODES.keys() & re.findall(r'(?:^|& )(\w+)', targets):
                yield f'{name} {message} {arrow} {target}'


def ends_in_ros(name: str) -> Iterator[str]:
    """Create one of our nodes; yield what it has in ROS, without what every node has."""
    module, _, class_name = NODES[name].rpartition('.')
    with tempfile.TemporaryDirectory() as folder:
        parameters = f'-p file:={folder}/readings.sqlite -p require_visual_confirmation:=true'
        rclpy.init(args=['--ros-args', '--log-level', 'error', *parameters.split()])
        node = getattr(importlib.import_module(module), class_name)()
        for form, entries_of in (
            ('{node} --> {entry}', Node.get_publisher_names_and_types_by_node),
            ('{entry} --> {node}', Node.get_subscriber_names_and_types_by_node),
            ('{node} -.-> {entry}', Node.get_client_names_and_types_by_node),
            ('{entry} -.-> {node}', Node.get_service_names_and_types_by_node),
            ('{node} ==> {entry}', actions.get_action_client_names_and_types_by_node),
            ('{entry} ==> {node}', actions.get_action_server_names_and_types_by_node),
        ):
            for entry, (kind, *_) in entries_of(node, name, '/'):
                package, _, message = kind.split('/')
                if package not in OF_EVERY_NODE and '/_action/' not in entry:
                    yield form.format(node=name, entry=f'{entry} {message}')
        node.destroy_node()
        rclpy.shutdown()


def facts_in_code() -> Facts:
    """Return what the documents must say of all nodes, and nothing else."""
    facts = {GRAPHS: {each for name in NODES for each in ends_in_ros(name)}}
    for command in importlib.metadata.entry_points(group='console_scripts'):
        if command.module.startswith('lupin_'):
            module = importlib.import_module(command.load().args[0])
            if settings := getattr(module, 'Settings', None):
                rows = {
                    f'| {each.name} | {default_text(each) or "empty"} |'
                    for each in dataclasses.fields(settings)
                }
                facts[f'parameters of {settings.__module__}.{settings.__name__}'] = rows
    return facts


def wrong_facts(document: Document, right: Facts) -> Iterator[str]:
    """Yield a finding for each row and each line of a graph that is not right."""
    for line in document.graph_lines:
        if not GRAPH_LINE.fullmatch(line):
            yield f'write this line of a graph as `source --> id["/name<br>Type"] --> target`: {line.strip()}'
    for mark, rows in document.facts().items():
        if mark in right:
            yield from (f'wrong in the {mark}: {row}' for row in sorted(rows - right[mark]))
        else:
            yield f'mark this table with `parameters of MODULE.CLASS`: {min(rows)}'


def findings_of(documents: list[Document], right: Facts) -> Iterator[str]:
    """Yield what is wrong in the documents, a line each, and what is in none of them."""
    missing = {mark: rows.copy() for mark, rows in right.items()}
    for document in documents:
        checks = (broken_links, unproved_blocks, missing_tests)
        found = [finding for check in checks for finding in check(document)]
        yield from (f'{document.path}: {each}' for each in [*found, *wrong_facts(document, right)])
        for mark, rows in document.facts().items():
            missing.get(mark, set()).difference_update(rows)
    for mark, rows in missing.items():
        yield from (f'no document has this in the {mark}: {row}' for row in sorted(rows))


def main(root: Path = ROOT) -> int:
    """Check every document; return the exit code."""
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'OFF'  # no other node of the same name
    documents = [Document(root, path) for path in files_in_git(root, '*.md')]
    findings = list(findings_of(documents, facts_in_code()))
    for finding in findings:
        print(f'docs: {finding}')
    blocks = sum(len(document.shell_blocks) for document in documents)
    print(f'{len(documents)} documents, {blocks} shell blocks: {pluralized(len(findings), "finding")}')
    return int(bool(findings))


if __name__ == '__main__':
    end(main, 'docs')
