"""`ros2 run lupin_planning register_layout`: find where the layout lies in the robot's map."""

import argparse
import math
import shlex
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import rclpy
from geometry_msgs.msg import PointStamped
from lupin_greenhouse_bridge.errors import (
    Interrupted,
    StartUpError,
    UsageError,
    escaped,
)
from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.runtime.arguments import Parser, number_type
from lupin_greenhouse_bridge.runtime.output import aligned_table, check_output_file, print_line
from lupin_greenhouse_bridge.runtime.run import node_creation, ros
from lupin_greenhouse_bridge.simulator.layout import Layout, require_layout
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.utilities import remove_ros_args

from lupin_planning.registration import (
    DEFAULT_CLICK_ERROR_M,
    DEFAULT_TOLERANCE_M,
    HEAD,
    LAYOUT_FRAME,
    MAP_FRAME,
    CannotFit,
    Point,
    fit,
    read_places,
    write_transform,
)

NAME = 'register_layout'
WRITTEN, NO_FIT, USAGE, INTERRUPTED = 0, 1, 2, 130
EPILOG = (
    'While a residual is above the tolerance, the tag is left out whose removal makes the others fit best.'
    ' At least 3 tags remain, and more than half of them. The expected error at the tag of the layout that is'
    ' farthest from the others must be within the tolerance too.'
    ' Exit code: 0 written, 1 the layout does not fit the map, 2 usage.'
)
TOLERANCE = (
    'largest residual in metres that a tag may have without being left out, and largest expected error in'
    ' metres'
)
CLICK_ERROR = (
    'assumed standard deviation of a position along each axis in metres; if the residuals show a larger one,'
    ' that one counts'
)
CLICK_TOPIC = '/clicked_point'  # of RViz's tool Publish Point


def main(args: list[str] | None = None) -> int:
    """Fit and write as the command line asks; return the exit code."""
    return run_registration(_parser(), _register, args)


def run_registration(
    parser: argparse.ArgumentParser,
    work: Callable[[Executor, argparse.Namespace], None],
    args: list[str] | None = None,
) -> int:
    """Run work(executor, options), and print the error that it raises, if any; return the exit code."""
    try:
        with ros(args) as executor:
            work(executor, parser.parse_args(remove_ros_args(sys.argv if args is None else args)[1:]))
            return WRITTEN
    except Interrupted:
        problem, exit_code = 'interrupted: nothing is kept, and nothing is written', INTERRUPTED
    except CannotFit as error:
        problem, exit_code = str(error), NO_FIT
    except (UsageError, StartUpError) as error:
        problem, exit_code = str(error), USAGE
    print(f'{parser.prog}: {problem}', file=sys.stderr)
    return exit_code


def _register(executor: Executor, options: argparse.Namespace) -> None:
    layout = layout_of(options)
    if options.click is None:
        places, frame_id = read_places(options.pairs), MAP_FRAME
    else:
        places, frame_id = _take_clicks(executor, layout, list(dict.fromkeys(options.click)))
    register(layout, places, frame_id, options)


def layout_of(options: argparse.Namespace) -> Layout:
    """Return the layout of the options. Raises UsageError or StartUpError before anybody clicks."""
    inputs = ('--pairs', getattr(options, 'pairs', None)), ('--tag-file', options.tag_file)
    check_output_file(Path(options.output), '--output', inputs, HEAD.encode())
    if options.output.endswith('.json'):
        raise UsageError(f"--output '{options.output}' is YAML: its name must end in .yaml")
    return require_layout(options.tag_file)


def register(layout: Layout, places: Mapping[str, Point], frame_id: str, options: argparse.Namespace) -> None:
    """
    Fit the layout to positions in a frame, print the residual of each tag, and write the file.

    `places` has x and y in metres by tag id, and `options` are those of add_arguments(). Raises CannotFit,
    UsageError for a tag that is not in the layout, and StartUpError for a file that cannot be written.
    """
    _check_known(layout, places)
    fitted = fit(_places_m(layout), places, options.tolerance, options.click_error)
    _raise_if_asked_to_end()
    frame = escaped(frame_id, 40)
    rows = [('tag', f'x in {frame} (m)', f'y in {frame} (m)', 'residual (m)', '')]
    for tag_id, (x, y) in places.items():
        remark = 'left out' if tag_id in fitted.left_out else ''
        rows.append(
            (escaped(tag_id, 40), f'{x:.3f}', f'{y:.3f}', f'{fitted.residuals_m[tag_id]:.3f}', remark)
        )
    print_line('\n'.join(aligned_table(rows, [1, 2, 3])))
    count = len(places) - len(fitted.left_out)
    if count == 2:
        print_line('two tags cannot show whether they are swapped or mirrored: add a third', sys.stderr)
    if frame_id.rpartition('/')[2] != MAP_FRAME:
        print_line(
            f"the positions are in the frame '{frame}': set RViz's Fixed Frame to {MAP_FRAME}", sys.stderr
        )
    write_transform(options.output, fitted.transform, frame_id)
    x, y, yaw = fitted.transform
    print_line(
        f'{count} of {len(places)} tags fit within {options.tolerance:g} m. The expected error is'
        f' {fitted.expected_error_m:.3f} m at the farthest tag, {escaped(fitted.farthest, 40)}.\n'
        f'The layout lies at x {x:.3f} m, y {y:.3f} m, yaw {yaw:.4f} rad in {frame_id}.'
        f' Written to {options.output}\n'
        f'With ROS installed, publish it: ros2 run tf2_ros static_transform_publisher --x {x:.6f} --y {y:.6f}'
        f' --yaw {yaw:.6f} --frame-id {shlex.quote(frame_id)} --child-frame-id {LAYOUT_FRAME}'
    )


def _raise_if_asked_to_end() -> None:
    if process.is_asked_to_end():
        raise Interrupted


def _places_m(layout: Layout) -> dict[str, Point]:
    return {tag_id: tag[:2] for tag_id, tag in layout.tags.items()}


def _check_known(layout: Layout, tag_ids: Iterable[str]) -> None:
    for tag_id in tag_ids:
        if tag_id not in layout.tags:
            raise UsageError(
                f"tag '{escaped(tag_id, 64)}' is not one of the {len(layout.tags)} tags of the layout:"
                " correct its id (ids have spaces between them), or set --tag-file to the bridge's"
            )


def node_in(executor: Executor, name: str) -> Node:
    """Return a new node, which the executor spins."""
    with node_creation():
        node = rclpy.create_node(name, start_parameter_services=False)
    executor.add_node(node)
    return node


def _take_clicks(executor: Executor, layout: Layout, tag_ids: list[str]) -> tuple[dict[str, Point], str]:
    """Return the clicked places by tag id, and the frame of all; raises Interrupted."""
    _check_known(layout, tag_ids)
    if len(tag_ids) < 2:
        raise UsageError('--click needs at least 2 tags')
    clicks: list[PointStamped] = []
    node_in(executor, NAME).create_subscription(PointStamped, CLICK_TOPIC, clicks.append, 10)
    places: dict[str, Point] = {}
    first_frame_id = ''
    for tag_id in tag_ids:
        x, y = layout.tags[tag_id][:2]
        print_line(
            f'click tag {escaped(tag_id, 40)} with Publish Point in RViz, {len(tag_ids) - len(places)} to go'
            f' (in the layout it is at x {x:g} m, y {y:g} m)',
        )
        while tag_id not in places:
            spin_until(executor, lambda: bool(clicks))
            click = clicks.pop(0)
            frame_id, place = click.header.frame_id, (click.point.x, click.point.y)
            if first_frame_id not in ('', frame_id):
                fault = (
                    f"in the frame '{escaped(frame_id, 64)}': the first was in '{first_frame_id}',"
                    " so set RViz's Fixed Frame to it"
                )
            elif not (frame_id.strip() and frame_id.isprintable() and all(map(math.isfinite, place))):
                fault = 'without a frame or a position: click on the map'
            else:
                first_frame_id, places[tag_id] = frame_id, place
                continue
            print_line(f'{NAME}: ignored a click {fault}', sys.stderr)
    return places, first_frame_id


def spin_until(executor: Executor, is_done: Callable[[], bool]) -> None:
    """Spin until is_done() is true; raises Interrupted after Ctrl-C or SIGTERM."""
    while not is_done():
        _raise_if_asked_to_end()
        executor.spin_once(timeout_sec=process.LONGEST_WAIT_SECONDS)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog=NAME,
        description="Find where the layout of the greenhouse lies in the robot's map.",
        epilog=EPILOG,
    )
    add = parser.add_mutually_exclusive_group(required=True).add_argument
    pairs = 'YAML or JSON file with the positions of tags in the map, such as {"7": [1.5, 7.3]}'
    add('--pairs', metavar='FILE', help=pairs)
    clicks = 'click these tags in RViz with Publish Point, one after the other in this order'
    add('--click', nargs='+', metavar='ID', help=clicks)
    add_arguments(parser)
    return parser


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of layout_of() and register()."""
    add = parser.add_argument
    metres = number_type('above 0 and below 1 m, such as 0.1', float, above=0.0, below=1.0)
    output = 'file to write; default: %(default)s'
    add('-o', '--output', default='layout_in_map.yaml', metavar='FILE', help=output)
    add('--tag-file', default='', metavar='FILE', help="the bridge's tag_file; default: the shipped one")
    for option, default, what in (
        ('--tolerance', DEFAULT_TOLERANCE_M, TOLERANCE),
        ('--click-error', DEFAULT_CLICK_ERROR_M, CLICK_ERROR),
    ):
        add(option, type=metres, metavar='M', default=default, help=f'{what}; default: %(default)s')
