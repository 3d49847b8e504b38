"""
`ros2 run lupin_simulation check_world`: check that the world matches the layout, and each tag is legible.

Exit code: 0 the world is right, 1 it is wrong, 2 it cannot be checked.
"""

import itertools
import math
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from lupin_greenhouse_bridge.errors import OneLineError
from lupin_greenhouse_bridge.planning.approach import find_approaches
from lupin_greenhouse_bridge.planning.free_space import FreeSpace
from lupin_greenhouse_bridge.planning.tag_poses import find_tag_poses, tables_of
from lupin_greenhouse_bridge.planning.viewpoints import ViewingLimits
from lupin_greenhouse_bridge.planning.walls import Walls, warning_of_outside
from lupin_greenhouse_bridge.runtime.arguments import Parser
from lupin_greenhouse_bridge.runtime.output import Progress, print_line
from lupin_greenhouse_bridge.simulator.layout import Layout
from lupin_tag_confirmation.detector import TagDetector
from lupin_tag_confirmation.settings import Settings

from lupin_simulation.generate_world import add_layout_options, make_world, read_layout
from lupin_simulation.rendered_world import RenderedWorld, View, view_ahead, viewpoint

SIDES_M = (0.04, 0.05)
DISTANCES_M = (0.3, 0.5, 1.0)
ANGLES_DEGREES = (0, 30, 45)
ROBOT_RADIUS_M = 0.15
RADII_M = (0.15, 0.20, 0.30)  # of the robots whose approach poses are checked
ROUNDING_M = 1e-9


class Setting(NamedTuple):
    """The views from one distance and angle, or from the poses of one robot."""

    name: str
    # By the number of a tag, groups of views: the detector must read the tag in all views of any group.
    views: dict[int, list[list[View]]]
    note: str = ''
    is_legible: bool = True  # False: no tag may be read


def tags_read(world: RenderedWorld, setting: Setting, progress: Progress) -> set[int]:
    """Return the numbers of the tags that the detector reads by the criteria of confirm_tag."""
    detector, settings = TagDetector(), Settings()

    def shows(view: View, number: int) -> bool:
        found = detector.detect(cv2.cvtColor(world.look(*view), cv2.COLOR_RGB2GRAY))
        return any(each.tag_number == number and not each.flaw(settings) for each in found)

    read = set()
    for done, (number, groups) in enumerate(setting.views.items()):
        progress(setting.name, done, len(setting.views))
        if any(all(shows(view, number) for view in group) for group in groups):
            read.add(number)
    progress.clear()
    return read


def matches_layout(world: RenderedWorld, layout: Layout, walls: Walls) -> bool:
    """Return whether the tags and tables are where the layout has them, and each tag faces the right way."""
    poses = find_tag_poses(layout, walls)
    expected = [
        (int(tag_id), x, y, math.cos(facing), math.sin(facing)) for tag_id, (x, y, facing) in poses.items()
    ]
    found = [(number, *tag.centre[:2], *tag.out[:2]) for number, tag in world.tags.items()]
    tables = tables_of(layout)
    return (
        (len(found), len(world.tables)) == (len(expected), len(tables))
        and np.allclose(sorted(found), sorted(expected), rtol=0, atol=ROUNDING_M)
        and np.allclose(world.tables, tables, rtol=0, atol=ROUNDING_M)
    )


def settings_of(world: RenderedWorld, layout: Layout, walls: Walls, side: str) -> Iterator[Setting]:
    """Yield each distance with each angle, then the approach poses of each robot, then the tags' backs."""
    free_space = FreeSpace(layout, walls, ROBOT_RADIUS_M)
    for distance_m, angle_degrees in itertools.product(DISTANCES_M, ANGLES_DEGREES):
        views, free = {}, 0
        for number, tag in sorted(world.tags.items()):
            eyes = [viewpoint(tag, distance_m, turn * angle_degrees) for turn in (1, -1)]
            standing = [View(eye, tag.centre) for eye in eyes if free_space.is_free(*eye[:2])]
            free += bool(standing)
            # Where a robot cannot stand, a picture from above the tables counts, from either side.
            views[number] = [standing] if standing else [[View(eye, tag.centre)] for eye in eyes]
        name, note = f'{side}, {distance_m:g} m, {angle_degrees}°', f' (a robot can stand there at {free})'
        yield Setting(name, views, note)
    for radius_m in RADII_M:
        poses = find_approaches(layout, walls, ViewingLimits(radius_m)).poses
        # The camera looks along the robot's x axis.
        views = {int(tag_id): [[view_ahead(*each[:3])]] for tag_id, each in poses.items()}
        yield Setting(f'{side}, approach poses of a robot of radius {radius_m:.2f} m', views)
    behind_m = -DISTANCES_M[0]
    views = {n: [[View(viewpoint(tag, behind_m, 0.0), tag.centre)]] for n, tag in world.tags.items()}
    yield Setting(f'{side}, from behind', views, is_legible=False)


def check(layout: Layout, walls: Walls, side_m: float, folder: Path) -> bool:
    """Make a world and check it; print a line for each setting; return whether it is right."""
    world, side = RenderedWorld(make_world(folder, layout, walls, side_m)), f'{100 * side_m:g} cm'
    is_right = matches_layout(world, layout, walls)
    counts = f'{len(world.tags)} tags and {len(world.tables)} tables'
    print_line(f'{side}: {counts}, {"where" if is_right else "NOT where"} the layout has them')
    progress = Progress('check_world')
    for setting in settings_of(world, layout, walls, side):
        read, numbers = tags_read(world, setting, progress), setting.views.keys()
        missing = ', '.join(str(each) for each in numbers if each not in read and setting.is_legible)
        share = f'{len(read)} of {len(numbers)} read{missing and f", not {missing}"}'
        print_line(f'{setting.name}: {share}{setting.note}')
        is_right &= bool(numbers) and read == (numbers if setting.is_legible else set())
    return is_right


def main(arguments: list[str] | None = None) -> int:
    """Check the world with both sizes of tags."""
    parser = Parser(prog='check_world', description='Check the SDF world with Drake.')
    add_layout_options(parser)
    parser.add_argument('--check', action='store_true', help='check the arguments, without Drake, and end')
    options = parser.parse_args(arguments)
    try:
        layout, walls = read_layout(options)
        if options.check:
            return 0
        if warning := warning_of_outside(layout, walls):
            print(f'check_world: {warning}', file=sys.stderr)
        with tempfile.TemporaryDirectory(prefix='check_world-') as folder:
            results = [check(layout, walls, side_m, Path(folder, f'{side_m:g}')) for side_m in SIDES_M]
    except OneLineError as error:
        print(f'check_world: {error}', file=sys.stderr)
        return 2
    print_line('the world is right' if all(results) else 'the world is WRONG')
    return 0 if all(results) else 1
