"""
Draw the ROS graph of each use, for the documents: the nodes, topics, services and actions with their types.

    make figure

It creates the nodes, asks ROS what they publish, subscribe to, offer and call, and draws what connects two of
them. A column is a node, a row a connection. The short arrows come first, and a node's line ends at its last
arrow, so that the long ones pass no line. Each figure has a light and a dark version. Their metadata names
the graph and the code: --check compares these.
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

OF_MISSION = Path(__file__).resolve().parents[2] / 'monorepo/lupin_mission/doc'
# The folder, and the nodes from left to right; a name stands for a node of somebody else.
USES = {
    'graph_call': (COMMITTED, ('your node', GreenhouseBridgeNode)),
    'graph_on_sight': (COMMITTED, ('your detector', ReadOnSightNode, GreenhouseBridgeNode, 'your node')),
    'graph_readings': (COMMITTED, (ReadOnSightNode, RecordReadingsNode, ShowReadingsNode, 'RViz')),
    'graph_mission': (
        OF_MISSION,
        (GreenhouseBridgeNode, 'your stack', MissionNode, 'Nav2', ConfirmTagNode, 'your camera'),
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
COLUMN, ROW = 2.7, 0.7  # inches
LONGEST_TYPE = 38  # characters beside an arrow from one column to the next


def connections(columns, others: dict[str, list[str]]) -> tuple[list[str], list[tuple]]:
    """Return the names of the nodes, and (kind, name, type, sources, targets) of what connects them."""
    nodes = [each if isinstance(each, str) else each() for each in columns]
    ends: dict[tuple, tuple[set, set]] = {}
    for column, node in enumerate(nodes):
        if isinstance(node, str):
            continue
        here = node.get_name(), node.get_namespace()
        found = [
            ('topic', 0, node.get_publisher_names_and_types_by_node(*here)),
            ('topic', 1, node.get_subscriber_names_and_types_by_node(*here)),
            ('service', 0, node.get_client_names_and_types_by_node(*here)),
            ('service', 1, node.get_service_names_and_types_by_node(*here)),
            ('action', 0, rclpy.action.get_action_client_names_and_types_by_node(node, *here)),
            ('action', 1, rclpy.action.get_action_server_names_and_types_by_node(node, *here)),
        ]
        for kind, side, names in found:
            for name, types in names:
                ends.setdefault((kind, name, types[0]), (set(), set()))[side].add(column)
    by_name = {name: sides for (_, name, _), sides in ends.items()}
    for other, names in others.items():
        for sources, targets in map(by_name.__getitem__, names):
            (targets if sources else sources).add(nodes.index(other))
    rows = [(*key, sorted(sources), sorted(targets - sources)) for key, (sources, targets) in ends.items()]
    rows = [row for row in rows if row[3] and row[4] and not any(each in row[1] for each in INNER)]
    names = [node if isinstance(node, str) else node.get_name() for node in nodes]
    for node in set(nodes) - set(names):
        node.destroy_node()
    return names, sorted(rows, key=lambda row: (length_of(row), row[3], row[4], row[1]))


def length_of(row: tuple) -> int:
    """Return over how many columns the longest arrow of a row goes."""
    return max(row[3] + row[4]) - min(row[3] + row[4])


def draw(names: list[str], rows: list[tuple], others, theme: str):
    """Return the figure of a graph."""
    paper, ink, line = THEMES[theme]
    size = COLUMN * len(names), ROW * (len(rows) + 1)
    figure, axes = pyplot.subplots(figsize=size, facecolor=paper)
    axes.set(xlim=(-0.5, len(names) - 0.5), ylim=(len(rows), -1), position=(0, 0, 1, 1))
    axes.axis('off')
    for column, name in enumerate(names):
        last = max(y for y, row in enumerate(rows) if column in row[3] + row[4])
        axes.plot([column, column], [-0.3, last + 0.7], color=line, linewidth=1, zorder=0)
        box = {'boxstyle': 'round,pad=0.4', 'facecolor': paper, 'edgecolor': ink}
        box |= {'edgecolor': line, 'linestyle': '--'} if name in others else {}
        axes.text(column, -0.5, name, ha='center', va='center', color=ink, weight='bold', bbox=box)
    for y, (kind, name, message, sources, targets) in enumerate(rows):
        style, colours = STYLES[kind]
        arrow = {'arrowstyle': '-|>', 'color': colours[theme], 'linestyle': style, 'lw': 1.4}
        for source in sources:
            for target in targets:
                ends = (target, y + 0.35), (source, y + 0.35)
                axes.annotate('', *ends, arrowprops=arrow | {'shrinkA': 0, 'shrinkB': 0})
        middle = (sources[0] + targets[0]) / 2
        package, _, short = message.rpartition('/')
        typed = short if package.startswith('lupin_') else message  # the mirror's package has another name
        typed = f'{kind}, {typed}'
        if length_of(rows[y]) == 1 and len(typed) > LONGEST_TYPE:
            typed = '/\n'.join(typed.rsplit('/', 1))
        text = {'ha': 'center', 'bbox': {'facecolor': paper, 'edgecolor': 'none', 'pad': 0.5}, 'zorder': 4}
        axes.text(middle, y + 0.27, name, va='bottom', color=colours[theme], size=10, **text)
        axes.text(middle, y + 0.43, typed, va='top', color=ink, size=8.5, **text)
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
            names, rows = connections(columns, OTHERS[use])
            fingerprint = hash_of(Path(__file__).read_bytes(), repr((names, rows)).encode())
            for theme in THEMES:
                path = place / f'{use}_{theme}.png'
                if not is_check:
                    save(draw(names, rows, OTHERS[use], theme), path, fingerprint)
                stale += [path] if fingerprint_of(path) != fingerprint else []
        rclpy.shutdown()
    print(*(f'graph: {path} is not up to date: make figure' for path in stale), sep='\n')
    return int(bool(stale))


if __name__ == '__main__':
    sys.exit(main())
