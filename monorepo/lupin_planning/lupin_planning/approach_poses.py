"""`ros2 run lupin_planning approach_poses`: print the pose from which a robot sees each tag."""

import argparse
import json
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml
from lupin_greenhouse_bridge.errors import OneLineError, UsageError, escaped
from lupin_greenhouse_bridge.runtime.arguments import DEGREES, METRES, Parser
from lupin_greenhouse_bridge.runtime.output import (
    Progress,
    aligned_table,
    check_output_file,
    print_line,
)
from lupin_greenhouse_bridge.simulator.layout import require_layout

from lupin_planning.approach import Approaches, find_approaches
from lupin_planning.occupancy import read_map
from lupin_planning.overrides import read_overrides
from lupin_planning.picture import check_ending, draw_route
from lupin_planning.poses import PoseInPlane
from lupin_planning.registration import Transform, read_registration
from lupin_planning.route import ORDERS, Route, plan_route
from lupin_planning.viewpoints import ViewingLimits
from lupin_planning.walls import add_wall_options, find_walls, warning_of_outside

Poses = dict[str, Any]  # what `--format json` prints
ALL_HAVE_A_POSE, SOME_HAVE_NONE, USAGE = 0, 1, 2
LIMITS = {  # by field of ViewingLimits: option, and help
    'robot_radius_m': ('--radius', 'radius of the robot in metres'),
    'clearance_m': ('--clearance', 'room beyond the radius to tables, walls and tags'),
    'arrival_tolerance_m': (
        '--arrival-tolerance',
        "how far from its pose the robot may stop, like Nav2's xy_goal_tolerance",
    ),
    'preferred_standoff_m': ('--standoff', 'preferred distance to the tag'),
    'smallest_standoff_m': ('--smallest-standoff', 'smallest distance to the tag'),
    'largest_standoff_m': ('--largest-standoff', 'largest distance to the tag'),
    'largest_angle_rad': ('--angle', 'largest incidence angle'),
    'camera_offset_m': ('--camera-offset', "how far the camera is ahead of the robot's centre"),
}


def main(args: list[str] | None = None) -> int:
    """Print the poses as the command line asks; return the exit code."""
    options = _parser().parse_args((sys.argv if args is None else args)[1:])
    try:
        data = _compute(options)
        print_line(FORMATS[options.format](data), end='')
        _warn(*(f"tag '{escaped(tag['tag_id'], 64)}': {tag['reason']}" for tag in data['unreachable']))
    except OneLineError as error:
        print(f'approach_poses: {error}', file=sys.stderr)
        return USAGE
    return SOME_HAVE_NONE if data['unreachable'] else ALL_HAVE_A_POSE


def _compute(options: argparse.Namespace) -> Poses:
    """Read the files, find the poses and the route, warn, draw; return the poses."""
    layout = require_layout(options.tag_file)
    layout_in_map = read_registration(options.layout_in_map)[1] if options.layout_in_map else None
    transform = layout_in_map or Transform()
    overrides, warnings = dict[str, PoseInPlane](), list[str]()
    if options.overrides:
        overrides, warnings = read_overrides(options.overrides, layout.tags, layout_in_map)
    walls = find_walls(layout, options.sim_config_file, options.walls)
    warnings += filter(None, [warning_of_outside(layout, walls)])
    limits = _limits_of(options)
    occupancy = None
    if options.unknown and not options.map:
        raise UsageError('--unknown needs a map: set --map FILE')
    if options.map:
        occupancy = read_map(options.map, unknown_is_free=options.unknown == 'free').in_layout(transform)
        if not options.layout_in_map:
            warnings.append('without --layout-in-map, the map is taken to be in the frame of the layout')
    if options.picture:
        map_files = occupancy.files if occupancy else ()
        check_output_file(options.picture, '--picture', [('--map', path) for path in map_files])
        check_ending(options.picture)
    start_m, end_m = (place and tuple(place) for place in (options.start, options.end))
    progress = Progress('approach_poses')
    try:
        approaches = find_approaches(
            layout,
            walls,
            limits,
            start_m=start_m,
            end_m=end_m,
            overrides=overrides,
            occupancy=occupancy,
            progress=progress,
        )
        progress.clear()
        _warn(*warnings, *approaches.warnings, *approaches.room_warnings.values())
        route = plan_route(
            approaches.grid,
            approaches.poses,
            start_m,
            options.order,
            end_m=end_m,
            progress=progress,
        )
    finally:
        progress.clear()
    if options.picture:
        draw_route(options.picture, layout, walls, approaches, route, occupancy)
        _warn(f'picture: {escaped(str(options.picture), 500)}')
    return _data_of(approaches, route, transform)


def _limits_of(options: argparse.Namespace) -> ViewingLimits:
    values = {name: getattr(options, name) for name in LIMITS}
    return ViewingLimits(
        **{name: math.radians(value) if name.endswith('_rad') else value for name, value in values.items()}
    )


def _warn(*lines: str) -> None:
    for line in lines:
        print_line(f'approach_poses: {line}', sys.stderr)


def _data_of(approaches: Approaches, route: Route, transform: Transform) -> Poses:
    """Return the poses in the order of the route, in the frame that the transform leads to."""
    poses = []
    for tag_id in route.tag_ids:
        pose = approaches.poses[tag_id]
        x, y = transform.point(pose.x, pose.y)
        moved = pose._replace(x=x, y=y, yaw=transform.heading(pose.yaw))._asdict()
        # + 0.0 makes 0.0 of -0.0.
        poses.append({'tag_id': tag_id, **{key: round(value, 6) + 0.0 for key, value in moved.items()}})
    unreachable = [{'tag_id': tag_id, 'reason': reason} for tag_id, reason in approaches.unreachable.items()]
    return {'poses': poses, 'unreachable': unreachable, 'length_m': round(route.length_m, 6)}


def _as_table(data: Poses) -> str:
    rows = [('tag', 'x (m)', 'y (m)', 'yaw (°)', 'standoff (m)', 'angle (°)')]
    for pose in data['poses']:
        yaw, angle = (f'{math.degrees(pose[key]):.0f}' for key in ('yaw', 'angle_rad'))
        x, y, standoff = (f'{pose[key]:.2f}' for key in ('x', 'y', 'distance_m'))
        rows.append((escaped(pose['tag_id'], 40), x, y, yaw, standoff, angle))
    count, missing = len(data['poses']), len(data['unreachable'])
    summary = (
        f'{count}/{count + missing} tags have an approach pose; the route is {data["length_m"]:.1f} m long'
    )
    return '\n'.join([*aligned_table(rows, range(1, len(rows[0]))), summary, ''])


FORMATS: dict[str, Callable[[Poses], str]] = {
    'table': _as_table,
    'yaml': lambda data: yaml.safe_dump(data, allow_unicode=True, sort_keys=False),
    'json': lambda data: json.dumps(data, ensure_ascii=False, indent=2) + '\n',
}


def _parser() -> argparse.ArgumentParser:
    default = ViewingLimits()
    parser = Parser(
        prog='approach_poses',
        description='Print the pose from which a robot sees each tag, in the order of visits.',
    )
    add = parser.add_argument
    file: dict[str, Any] = {'metavar': 'FILE'}
    place: dict[str, Any] = {'type': METRES, 'nargs': 2, 'metavar': ('X', 'Y')}
    add('--tag-file', **file, default='', help="the bridge's tag_file; default: the one of mdp-greenhouse")
    add_wall_options(parser)
    for name, (option, what) in LIMITS.items():
        value, unit, kind = getattr(default, name), 'M', METRES
        if name.endswith('_rad'):
            value, unit, kind = math.degrees(value), 'DEGREES', DEGREES
        shown = f'{what} (default: %(default)g)'
        add(option, dest=name, type=kind, default=value, metavar=unit, help=shown)
    add(
        '--order',
        choices=ORDERS,
        default='shortest',
        help='order of the visits: given (as in the tag file), or shortest (the shortest route found)'
        ' (default: %(default)s)',
    )
    add('--start', **place, help='where the robot starts: x and y in metres, in the layout')
    add('--end', **place, help='where the route ends, such as at a dock: x and y in metres, in the layout')
    add('--overrides', **file, help='YAML file of poses that are set by hand')
    add('--layout-in-map', **file, help='file that register_layout has written: print the poses in the map')
    add(
        '--map',
        **file,
        help="YAML file of the robot's map, as Nav2's map_saver_cli writes it: the poses and the route avoid"
        ' its obstacles too',
    )
    add(
        '--unknown',
        choices=('occupied', 'free'),
        help='what the unknown cells of the map count as (default: occupied)',
    )
    add('--format', choices=FORMATS, default='table', help='format of the output (default: %(default)s)')
    add('--picture', **file, type=Path, help='draw the layout, the poses and the route')
    return parser
