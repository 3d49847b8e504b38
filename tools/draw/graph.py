"""
Draw the ROS graph of each use, for the documents: the nodes, topics, services and actions with their types.

    make figure

It creates the nodes, asks ROS what they publish, subscribe to, offer and call, and draws what connects two of
them. Each arrow goes to the next column, or to the box below or above, so that none crosses another. Each
figure has a light and a dark version. Their metadata names the graph and the code: --check compares these.
"""

import os
import sys
import tempfile
from collections import defaultdict
from collections.abc import Collection, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import matplotlib
import rclpy
from figure import COMMITTED, Picture, draw_or_check, hash_of, parser_of
from lupin_greenhouse_bridge.bridge_node import GreenhouseBridgeNode
from lupin_greenhouse_bridge.display.show_readings import ShowReadingsNode
from lupin_greenhouse_bridge.reading.read_on_sight import ReadOnSightNode
from lupin_greenhouse_bridge.recording.record_readings import RecordReadingsNode
from lupin_mission.mission_orchestrator import MissionNode
from lupin_tag_confirmation.confirm_tag import ConfirmTagNode
from matplotlib import pyplot
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch
from rclpy.action.graph import (
    get_action_client_names_and_types_by_node,
    get_action_server_names_and_types_by_node,
)
from rclpy.node import Node

OF_MISSION = Path(__file__).resolve().parents[2] / 'monorepo/lupin_mission/doc'


# Of each figure: its folder; its columns of nodes from left to right, in which a name is a node of somebody
# else; and what that node has: the other ends of what our nodes have.
USES: dict[str, tuple[Path, list[list[Any]], dict[str, list[str]]]] = {
    'graph_call': (
        COMMITTED,
        [['your node'], [GreenhouseBridgeNode]],
        {'your node': ['/greenhouse_bridge/get_tag_reading']},
    ),
    'graph_on_sight': (
        COMMITTED,
        [['your detector'], [ReadOnSightNode], [GreenhouseBridgeNode, 'your node']],
        {'your detector': ['/detections'], 'your node': ['/read_on_sight/readings']},
    ),
    'graph_readings': (
        COMMITTED,
        [[ReadOnSightNode], [RecordReadingsNode, ShowReadingsNode], ['RViz']],
        {'RViz': ['/show_readings/markers', '/show_readings/field']},
    ),
    'graph_mission': (
        OF_MISSION,
        [['your stack', GreenhouseBridgeNode], [MissionNode], ['Nav2', ConfirmTagNode, 'your camera']],
        {
            'your stack': ['/mission/start', '/mission/state', '/floranova/observations'],
            'Nav2': ['/navigate_to_pose', '/amcl_pose', '/map'],
            'your camera': ['/camera/color/image_raw'],
        },
    ),
}
INNER = ('/_action/', '/rosout', '/parameter_events')
THEMES = {'light': ('white', '#1f2328', '#8c959f'), 'dark': ('#0d1117', '#e6edf3', '#6e7681')}
STYLES = {
    'topic': ('solid', {'light': '#0969da', 'dark': '#58a6ff'}),
    'service': ('dashed', {'light': '#1a7f37', 'dark': '#56d364'}),
    'action': ('dashdot', {'light': '#bc4c00', 'dark': '#f0883e'}),
}
BOX, GAP, ROW, FOOT = 1.6, 2.35, 0.85, 0.5  # inches
LONGEST_TEXT = 30  # characters on an arrow
FOOTNOTE = """An arrow points to the subscriber of a topic, or to the server of a service or an action.
Dashed box: a node of your own, or of another project."""


End: TypeAlias = tuple[str, str, str]  # kind, name and type of a topic, a service or an action


class Link(NamedTuple):
    """What connects two nodes: a topic, a service or an action."""

    kind: str
    name: str
    message: str
    source: str
    target: str

    def other_end(self, node: str) -> str:
        """Return the node at the other end."""
        return self.target if node == self.source else self.source


def ends_of(node: Node) -> Iterator[tuple[bool, End]]:
    """Yield all that a node has, each with whether the node is its target."""
    for kind, is_target, entries_of in (
        ('topic', False, Node.get_publisher_names_and_types_by_node),
        ('topic', True, Node.get_subscriber_names_and_types_by_node),
        ('service', False, Node.get_client_names_and_types_by_node),
        ('service', True, Node.get_service_names_and_types_by_node),
        ('action', False, get_action_client_names_and_types_by_node),
        ('action', True, get_action_server_names_and_types_by_node),
    ):
        for name, types in entries_of(node, node.get_name(), node.get_namespace()):
            if not any(inner in name for inner in INNER):
                yield is_target, (kind, name, types[0])


def connections(columns: list[list[Any]], others: dict[str, list[str]]) -> tuple[list[list[str]], list[Link]]:
    """Return the names of the nodes by column, and their links; creates the nodes and destroys them."""
    names: list[list[str]] = []
    sources: dict[End, set[str]] = defaultdict(set)
    targets: dict[End, set[str]] = defaultdict(set)
    for column in columns:
        made = [each if isinstance(each, str) else each() for each in column]
        names.append([each if isinstance(each, str) else each.get_name() for each in made])
        for node in (each for each in made if not isinstance(each, str)):
            for is_target, end in ends_of(node):
                (targets if is_target else sources)[end].add(node.get_name())
            node.destroy_node()
    for other, entries in others.items():
        for end in [end for end in {**sources, **targets} if end[1] in entries]:
            (targets if sources[end] else sources)[end].add(other)
    return names, sorted(
        Link(*end, source, target)
        for end in sources
        for source in sources[end]
        for target in targets[end] - {source}
    )


def rows_of(columns: list[list[str]], links: list[Link]) -> dict[Link, int]:
    """Return the row of each link: those of a node are neighbours on each side, or below it."""
    column_of = {name: number for number, names in enumerate(columns) for name in names}
    rows: dict[Link, int] = {}

    def links_of(name: str, columns_away: int) -> list[Link]:
        ours = [link for link in links if name in (link.source, link.target)]
        return [link for link in ours if column_of[link.other_end(name)] - column_of[name] == columns_away]

    for names in sorted(columns, key=len, reverse=True):  # a node alone in its column follows the others
        first = 0
        for name in names:
            left, below, right = (links_of(name, columns_away) for columns_away in (-1, 0, 1))
            for side in (left, right):
                for row, link in enumerate(side, start=first):
                    rows.setdefault(link, row)
            first += max(len(left), len(right))
            for link in below:
                rows.setdefault(link, first)
            first += len(below)
    return rows


def draw(columns: list[list[str]], links: list[Link], others: Collection[str], theme: str) -> Figure:
    """Return the figure of a graph, in inches from its upper left corner."""
    paper, ink, line = THEMES[theme]
    rows = rows_of(columns, links)
    lefts = {name: n * (BOX + GAP) for n, names in enumerate(columns) for name in names}
    spans = {}  # of each box in rows: beside its arrows, or below the only one
    for name, left in lefts.items():
        mine = [(row, lefts[link.other_end(name)] != left) for link, row in rows.items() if name in link[3:]]
        beside = [row for row, is_beside in mine if is_beside] or [row + 1 for row, _ in mine]
        spans[name] = min(beside) * ROW + 0.06, (max(beside) + 1) * ROW - 0.06
    width, height = len(columns) * (BOX + GAP) - GAP, max(bottom for _, bottom in spans.values()) + 0.06
    figure, axes = pyplot.subplots(figsize=(width + 0.2, height + FOOT + 0.1), facecolor=paper)
    axes.set(xlim=(-0.1, width + 0.1), ylim=(height + FOOT, -0.1), position=(0, 0, 1, 1))
    axes.axis('off')
    for name, left in lefts.items():
        top, bottom = spans[name]
        edge, dashes = (line, '--') if name in others else (ink, '-')
        rounded = 'round,pad=0,rounding_size=0.08'
        style: dict[str, Any] = {'boxstyle': rounded, 'fc': paper, 'ec': edge, 'ls': dashes}
        axes.add_patch(FancyBboxPatch((left, top), BOX, bottom - top, **style))
        text = name.replace('_', '_\n', 1) if len(name) > LONGEST_TEXT / 2 else name
        middle = left + BOX / 2, (top + bottom) / 2
        axes.text(*middle, text, ha='center', va='center', color=ink, weight='bold')
    for link, row in rows.items():
        dashes, colours = STYLES[link.kind]
        left, right, y = lefts[link.source], lefts[link.target], (row + 0.5) * ROW
        is_vertical = left == right
        if is_vertical:
            is_up = spans[link.source] > spans[link.target]
            x, side = left + BOX / 2 - 0.1, 'right'
            start = left + BOX / 2, spans[link.source][not is_up]
            end = left + BOX / 2, spans[link.target][is_up]
        else:
            start, end = (left + BOX * (left < right), y), (right + BOX * (left > right), y)
            x, side = (start[0] + end[0]) / 2, 'center'
        arrow = {'arrowstyle': '-|>', 'color': colours[theme], 'ls': dashes, 'lw': 1.4}
        axes.annotate('', end, start, arrowprops=arrow | {'shrinkA': 0, 'shrinkB': 0})
        package, _, short = link.message.rpartition('/')
        typed = short if package.startswith('lupin_') else link.message  # the mirror's package differs
        above, below = (
            '/\n'.join(text.rsplit('/', 1)) if len(text) > LONGEST_TEXT and not is_vertical else text
            for text in (link.name, f'{link.kind}, {typed}')
        )
        axes.text(x, y - 0.06, above, ha=side, va='bottom', color=colours[theme], size=10)
        axes.text(x, y + 0.06, below, ha=side, va='top', color=ink, size=8.5)
    axes.text(width / 2, height + FOOT / 2, FOOTNOTE, ha='center', va='center', color=ink, size=8.5)
    return figure


def main(arguments: list[str] | None = None) -> int:
    """Draw or check; exit code 0: done, 1: not up to date."""
    is_check = parser_of('graph', __doc__).parse_args(arguments).check
    matplotlib.use('Agg')
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'OFF'  # the nodes of this process, and no others
    pictures: dict[Path, Picture] = {}
    with tempfile.TemporaryDirectory() as folder:
        parameters = f'-p file:={folder}/readings.sqlite -p require_visual_confirmation:=true'
        rclpy.init(args=['--ros-args', '--log-level', 'error', *parameters.split()])
        for use, (place, columns, others) in USES.items():
            names, links = connections(columns, others)
            fingerprint = hash_of(Path(__file__).read_bytes(), repr((names, links)).encode())
            for theme in THEMES:
                pictures[place / f'{use}_{theme}.png'] = (
                    fingerprint,
                    partial(draw, names, links, others, theme),
                )
        rclpy.shutdown()
    return draw_or_check('graph', pictures, is_check=is_check)


if __name__ == '__main__':
    sys.exit(main())
