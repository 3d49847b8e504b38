"""
`ros2 run lupin_simulation check_world`: check that the world matches the layout, and each tag is legible.

Exit code: 0 the world is right, 1 it is wrong, 2 it cannot be checked.
"""

import argparse
import itertools
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from lupin_greenhouse_bridge.errors import OneLineError
from lupin_greenhouse_bridge.planning.approach import ViewingLimits, find_approaches
from lupin_greenhouse_bridge.planning.tag_poses import tables_of
from lupin_greenhouse_bridge.planning.walls import Walls, add_wall_options
from lupin_greenhouse_bridge.runtime.output import Progress, print_line
from lupin_tag_confirmation.detector import TagDetector
from lupin_tag_confirmation.settings import Criteria

from lupin_simulation.generate_world import make_world
from lupin_simulation.rendered_world import RenderedWorld, Tag, view_ahead, viewpoint

SIDES_M = (0.04, 0.05)
DISTANCES_M = (0.3, 0.5, 1.0)
ANGLES_DEGREES = (0, 30, 45)
ROBOT_RADIUS_M = 0.15
RADII_M = (0.15, 0.20, 0.30)  # of the approach poses
SAME_M = 1e-9
STEP_M = 0.02


class Looks:
    """Looks at the tags of a world like confirm_tag, and shows how many it has looked at."""

    def __init__(self, world, total: int):
        self._world, self._detector, self._criteria = world, TagDetector(), Criteria()
        self._progress, self._done, self._total = Progress('check_world'), 0, total

    def _has(self, number: int, eye: np.ndarray, at: np.ndarray) -> bool:
        found = self._detector.detect(cv2.cvtColor(self._world.look(eye, at), cv2.COLOR_RGB2GRAY))
        return any(each.tag_number == number and not self._criteria.flaw_of(each) for each in found)

    def read(self, views: dict[int, tuple]) -> set[int]:
        """Return the tags that are read in `views`: by tag, all or any, and pairs of (eye, point ahead)."""
        read = set()
        for number, (enough, looks) in views.items():
            if enough(self._has(number, *each) for each in looks):
                read.add(number)
            self._done += 1
            self._progress('rendered views of tags', self._done, self._total)
        self._progress.end()
        return read


def corners_of(world) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and the highest x and y of the tags and tables."""
    points = [tag.centre[:2] for tag in world.tags.values()]
    points += [corner for x0, y0, x1, y1 in world.tables for corner in ((x0, y0), (x1, y1))]
    return np.min(points, axis=0), np.max(points, axis=0)


def faces_outwards(tag: Tag, tables: list, middle: np.ndarray) -> bool:
    """Return whether a tag faces away from its nearest table, or, without tables, towards the middle."""
    front, back = (tag.centre[:2] + turn * STEP_M * tag.out[:2] for turn in (1, -1))
    if not tables:
        return np.linalg.norm(front - middle) <= np.linalg.norm(back - middle)
    nearest = min(tables, key=lambda table: table.distance_m(*tag.centre[:2]))
    before, behind = nearest.distance_m(*front), nearest.distance_m(*back)
    return before > behind or before == behind == 0.0  # the latter in the middle of a table


def print_share(setting: str, ids, read: set, note: str = '') -> bool:
    """Print how many of these tags were read, and which were not; return whether all were."""
    missing = [each for each in ids if each not in read]
    names = f', not {", ".join(map(str, missing))}' if missing else ''
    print_line(f'{setting}: {len(ids) - len(missing)} of {len(ids)} read{names}{note}')
    return not missing


def check_layout(world, layout) -> bool:
    """Return whether the tags and tables are where the layout has them, and the tags face outwards."""
    tables = tables_of(layout)
    low, high = corners_of(world)
    return (
        {str(number): tuple(tag.centre[:2]) for number, tag in world.tags.items()}
        == {tag_id: tag[:2] for tag_id, tag in layout.tags.items()}
        and len(tables) == len(world.tables)
        and np.allclose(tables, world.tables, rtol=0, atol=SAME_M)
        and all(faces_outwards(tag, tables, (low + high) / 2) for tag in world.tags.values())
    )


def check_distances(world, looks: Looks, tables: list, walls: Walls, side: str) -> bool:
    """Return whether each tag is read from each distance and angle at which a robot can stand."""

    def can_stand(eye) -> bool:
        x, y = eye[:2]
        to_wall_m = min(x - walls.x0, y - walls.y0, walls.x1 - x, walls.y1 - y)
        return min([to_wall_m, *(each.distance_m(x, y) for each in tables)]) > ROBOT_RADIUS_M

    are_read = []
    for distance_m, angle_degrees in itertools.product(DISTANCES_M, ANGLES_DEGREES):
        views, free = {}, 0
        for number, tag in sorted(world.tags.items()):
            eyes = [viewpoint(tag, distance_m, turn * angle_degrees) for turn in (1, -1)]
            # Where a robot cannot stand, a picture from above the tables counts, from either side.
            standing = [eye for eye in eyes if can_stand(eye)]
            free += bool(standing)
            views[number] = (all if standing else any), [(eye, tag.centre) for eye in standing or eyes]
        setting, note = f'{side}, {distance_m:g} m, {angle_degrees}°', f' (a robot can stand there at {free})'
        are_read.append(print_share(setting, views, looks.read(views), note))
    return all(are_read)


def check(options: argparse.Namespace, side_m: float, folder: Path) -> bool:
    """Make a world and check it; print a line for each setting; return whether it is right."""
    sdf_file, layout, walls = make_world(
        folder / f'{side_m:g}', options.tag_file, side_m, options.sim_config_file, options.walls
    )
    world, side = RenderedWorld(sdf_file), f'{100 * side_m:g} cm'
    is_right = check_layout(world, layout)
    counts = f'{len(world.tags)} tags and {len(world.tables)} tables'
    print_line(f'{side}: {counts}, {"where" if is_right else "NOT where"} the layout has them')
    settings = len(DISTANCES_M) * len(ANGLES_DEGREES) + len(RADII_M) + 1
    looks = Looks(world, settings * len(world.tags))
    is_right &= check_distances(world, looks, tables_of(layout), walls, side)
    for radius_m in RADII_M:
        poses = find_approaches(layout, walls, ViewingLimits(radius_m)).poses
        # The camera looks along the robot's x axis.
        views = {int(tag_id): (all, [view_ahead(each.x, each.y, each.yaw)]) for tag_id, each in poses.items()}
        setting = f'{side}, approach poses of a robot of radius {radius_m:.2f} m'
        is_right &= print_share(setting, views, looks.read(views))
    distance_m, tags = DISTANCES_M[0], world.tags.items()
    behind = looks.read({n: (all, [(tag.centre - distance_m * tag.out, tag.centre)]) for n, tag in tags})
    print_line(f'{side}, from behind: {len(behind)} of {len(world.tags)} read')
    return is_right and not behind


def main(arguments: list[str] | None = None) -> int:
    """Check the world with both sizes of tags."""
    parser = argparse.ArgumentParser(prog='check_world', description='Check the SDF world with Drake.')
    parser.add_argument(
        '--tag-file',
        default='',
        metavar='FILE',
        help="the bridge's tag_file; default: the one of mdp-greenhouse",
    )
    add_wall_options(parser)
    options = parser.parse_args(arguments)
    try:
        with tempfile.TemporaryDirectory(prefix='check_world-') as folder:
            results = [check(options, side_m, Path(folder)) for side_m in SIDES_M]
    except OneLineError as error:
        print(f'check_world: {error}', file=sys.stderr)
        return 2
    print_line('the world is right' if all(results) else 'the world is WRONG')
    return 0 if all(results) else 1
