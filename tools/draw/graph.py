"""
Draw the ROS graph of each use, for the documents: the nodes, topics, services and actions with their types.

    make figure

It creates the nodes, asks ROS what they publish, subscribe to, offer and call, and draws what connects two of
them. Each arrow goes to the next column, or to the box below or above, so that none crosses another. Each
figure has a light and a dark version. Their metadata names the graph and the code: --check compares these.
"""

import argparse
import os
import sys
import tempfile
from pathlib import Path

import matplotlib
import rclpy
import rclpy.action
from figure import COMMITTED, fingerprint_of, hash_of, save
from lupin_greenhouse_bridge.bridge_node import GreenhouseBridgeNode
from lupin_greenhouse_bridge.display.show_readings import ShowReadingsNode
from lupin_greenhouse_bridge.reading.read_on_sight import ReadOnSightNode
from lupin_greenhouse_bridge.recording.record_readings import RecordReadingsNode
from lupin_mission.mission_orchestrator import MissionNode
from lupin_tag_confirmation.confirm_tag import ConfirmTagNode
from matplotlib import pyplot
from matplotlib.patches import FancyBboxPatch

OF_MISSION = Path(__file__).resolve().parents[2] / 'monorepo/lupin_mission/doc'
# The folder, and the columns of nodes from left to right; a name stands for a node of somebody else.
USES = {
    'graph_call': (COMMITTED, [['your node'], [GreenhouseBridgeNode]]),
    'graph_on_sight': (
        COMMITTED,
        [['your detector'], [ReadOnSightNode], [GreenhouseBridgeNode, 'your node']],
    ),
    'graph_readings': (COMMITTED, [[ReadOnSightNode], [RecordReadingsNode, ShowReadingsNode], ['RViz']]),
    'graph_mission': (
        OF_MISSION,
        [['your stack', GreenhouseBridgeNode], [MissionNode], ['Nav2', ConfirmTagNode, 'your camera']],
    ),
}
# What these nodes publish, subscribe to, offer or call: the other end of what a node of ours has.
OTHERS = {
    'graph_call': {'your node': ['/greenhouse_bridge/get_tag_reading']},
    'graph_on_sight': {'your detector': ['/detections'], 'your node': ['/read_on_sight/readings']},
    'graph_readings': {'RViz': ['/show_readings/markers', '/show_readings/field']},
    'graph_mission': {
        'your stack': ['/mission/start', '/mission/state', '/floranova/observations'],
        'Nav2': ['/navigate_to_pose', '/amcl_pose', '/map'],
        'your camera': ['/camera/color/image_raw'],
    },
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


def connections(columns, others: dict[str, list[str]]) -> tuple[list[list[str]], list[tuple]]:
    """Return the names of the nodes by column, and (kind, name, type, source, target) of each link."""
    made = [[each if isinstance(each, str) else each() for each in column] for column in columns]
    names = [[node if isinstance(node, str) else node.get_name() for node in column] for column in made]
    nodes = [node for column in made for node in column if not isinstance(node, str)]
    ends: dict[tuple, tuple[set, set]] = {}
    for node in nodes:
        here = node.get_name(), node.get_namespace()
        found = [
            ('topic', 0, node.get_publisher_names_and_types_by_node(*here)),
            ('topic', 1, node.get_subscriber_names_and_types_by_node(*here)),
            ('service', 0, node.get_client_names_and_types_by_node(*here)),
            ('service', 1, node.get_service_names_and_types_by_node(*here)),
            ('action', 0, rclpy.action.get_action_client_names_and_types_by_node(node, *here)),
            ('action', 1, rclpy.action.get_action_server_names_and_types_by_node(node, *here)),
        ]
        for kind, side, entries in found:
            for name, types in entries:
                ends.setdefault((kind, name, types[0]), (set(), set()))[side].add(here[0])
    by_name = {name: sides for (_, name, _), sides in ends.items()}
    for other, entries in others.items():
        for sources, targets in map(by_name.__getitem__, entries):
            (targets if sources else sources).add(other)
    for node in nodes:
        node.destroy_node()
    return names, sorted(
        (*key, source, target)
        for key, (sources, targets) in ends.items()
        if not any(each in key[1] for each in INNER)
        for source in sources
        for target in targets - {source}
    )


def rows_of(columns: list[list[str]], links: list[tuple]) -> dict[tuple, int]:
    """Return the row of each link: those of a node are neighbours on each side, or below it."""
    column_of = {name: number for number, names in enumerate(columns) for name in names}
    rows: dict[tuple, int] = {}
    for names in sorted(columns, key=len, reverse=True):  # a node alone in its column follows the others
        first = 0
        for name in names:
            sides = {-1: [], 0: [], 1: []}
            for link in links:
                if name in link[3:]:
                    (other,) = {*link[3:]} - {name}
                    sides[column_of[other] - column_of[name]].append(link)
            below = sides.pop(0)
            for each in sides.values():
                rows = {link: first + number for number, link in enumerate(each)} | rows
            first += max(map(len, sides.values()))
            rows = dict.fromkeys(below, first) | rows
            first += len(below)
    return rows


def draw(columns: list[list[str]], links: list[tuple], others, theme: str):
    """Return the figure of a graph, in inches from its upper left corner."""
    paper, ink, line = THEMES[theme]
    rows = rows_of(columns, links)
    lefts = {name: n * (BOX + GAP) for n, names in enumerate(columns) for name in names}
    spans = {}  # of each box in rows: beside its arrows, or below the only one
    for name in lefts:
        mine = [(row, lefts[link[3]] == lefts[link[4]]) for link, row in rows.items() if name in link[3:]]
        beside = [row for row, is_vertical in mine if not is_vertical] or [row + 1 for row, _ in mine]
        spans[name] = min(beside) * ROW + 0.06, (max(beside) + 1) * ROW - 0.06
    width, height = len(columns) * (BOX + GAP) - GAP, max(bottom for _, bottom in spans.values()) + 0.06
    size = width + 0.2, height + FOOT + 0.1
    figure, axes = pyplot.subplots(figsize=size, facecolor=paper)
    axes.set(xlim=(-0.1, width + 0.1), ylim=(height + FOOT, -0.1), position=(0, 0, 1, 1))
    axes.axis('off')
    for name, left in lefts.items():
        top, bottom = spans[name]
        edge = {'edgecolor': line, 'linestyle': '--'} if name in others else {'edgecolor': ink}
        style = {'boxstyle': 'round,pad=0,rounding_size=0.08', 'facecolor': paper, **edge}
        axes.add_patch(FancyBboxPatch((left, top), BOX, bottom - top, **style))
        text = name.replace('_', '_\n', 1) if len(name) > LONGEST_TEXT / 2 else name
        style = {'ha': 'center', 'va': 'center', 'color': ink, 'weight': 'bold'}
        axes.text(left + BOX / 2, (top + bottom) / 2, text, **style)
    for (kind, name, message, source, target), row in rows.items():
        style, colours = STYLES[kind]
        is_right = lefts[source] < lefts[target]
        y, is_up = (row + 0.5) * ROW, spans[source] > spans[target]
        start, end = (lefts[source] + BOX * is_right, y), (lefts[target] + BOX * (not is_right), y)
        middle, side = (start[0] + end[0]) / 2, 'center'
        if is_vertical := lefts[source] == lefts[target]:
            middle = lefts[source] + BOX / 2
            start, end = (middle, spans[source][not is_up]), (middle, spans[target][is_up])
            middle, side = middle - 0.1, 'right'
        arrow = {'arrowstyle': '-|>', 'color': colours[theme], 'linestyle': style, 'lw': 1.4}
        axes.annotate('', end, start, arrowprops=arrow | {'shrinkA': 0, 'shrinkB': 0})
        package, _, short = message.rpartition('/')
        typed = short if package.startswith('lupin_') else message  # the mirror's package has another name
        above, below = (
            '/\n'.join(text.rsplit('/', 1)) if len(text) > LONGEST_TEXT and not is_vertical else text
            for text in (name, f'{kind}, {typed}')
        )
        axes.text(middle, y - 0.06, above, ha=side, va='bottom', color=colours[theme], size=10)
        axes.text(middle, y + 0.06, below, ha=side, va='top', color=ink, size=8.5)
    axes.text(width / 2, height + FOOT / 2, FOOTNOTE, ha='center', va='center', color=ink, size=8.5)
    return figure


def main(arguments: list[str] | None = None) -> int:
    """Draw or check; exit code 0: done, 1: not up to date."""
    parser = argparse.ArgumentParser(prog='graph', description=__doc__.strip().splitlines()[0])
    parser.add_argument('--check', action='store_true', help='compare the committed figures; draw nothing')
    is_check = parser.parse_args(arguments).check
    matplotlib.use('Agg')
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'OFF'  # the nodes of this process, and no others
    stale = []
    with tempfile.TemporaryDirectory() as folder:
        parameters = f'-p file:={folder}/readings.sqlite -p require_visual_confirmation:=true'
        rclpy.init(args=['--ros-args', '--log-level', 'error', *parameters.split()])
        for use, (place, columns) in USES.items():
            names, links = connections(columns, OTHERS[use])
            fingerprint = hash_of(Path(__file__).read_bytes(), repr((names, links)).encode())
            for theme in THEMES:
                path = place / f'{use}_{theme}.png'
                if not is_check:
                    save(draw(names, links, OTHERS[use], theme), path, fingerprint)
                stale += [path] if fingerprint_of(path) != fingerprint else []
        rclpy.shutdown()
    print(*(f'graph: {path} is not up to date: make figure' for path in stale), sep='\n')
    return int(bool(stale))


if __name__ == '__main__':
    sys.exit(main())
