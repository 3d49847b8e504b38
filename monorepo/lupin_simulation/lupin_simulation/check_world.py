"""
`ros2 run lupin_simulation check_world`: check that the SDF world matches the layout.

Each tag must be legible for the camera.

Exit code: 0 the world is right, 1 it is wrong, 2 it cannot be checked.
"""

import argparse
import math
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
from lupin_greenhouse_bridge.errors import OneLineError
from lupin_greenhouse_bridge.planning.approach import ViewingLimits, find_approaches
from lupin_greenhouse_bridge.planning.free_space import MARGIN_M
from lupin_greenhouse_bridge.planning.tag_poses import tables_of
from lupin_tag_confirmation.detector import TagDetector
from lupin_tag_confirmation.settings import Criteria

from lupin_simulation.generate_world import make_world
from lupin_simulation.opening import open_world
from lupin_simulation.tag_poses_in_world import TAG_HEIGHT_M
from lupin_simulation.view import Tag, viewpoint

SIDES_M = (0.04, 0.05)
DISTANCES_M = (0.3, 0.5, 1.0)
ANGLES_DEGREES = (0, 30, 45)
ROBOT_RADIUS_M = 0.15
RADII_M = (0.15, 0.20, 0.30)  # of the approach poses
SAME_M = 1e-9
STEP_M = 0.02
LINE_SECONDS = 15.0  # where no terminal can rewrite a line


class Views:
    """Counts the views of tags that are rendered, and shows the count on standard error."""

    def __init__(self, total: int):
        self._done, self._total = 0, total
        self._next_s = 0.0

    def count(self) -> None:
        """Count one, and show it: on a terminal in one line, elsewhere in a line every 15 s."""
        self._done += 1
        text = f'check_world: {self._done} of {self._total} views of tags are rendered'
        if sys.stderr.isatty():
            print(f'\r{text}', end='', file=sys.stderr, flush=True)
        elif time.monotonic() >= self._next_s:
            print(text, file=sys.stderr, flush=True)
            self._next_s = time.monotonic() + LINE_SECONDS

    def clear(self) -> None:
        """Remove the count from a terminal, for another line."""
        if sys.stderr.isatty():
            print('\r\033[K', end='', file=sys.stderr, flush=True)


def seen_from(world, detector: TagDetector, eye: np.ndarray, at: np.ndarray) -> set[int]:
    """Return the ids that confirm_tag would accept in a picture from this viewpoint."""
    picture = cv2.cvtColor(world.look(eye, at), cv2.COLOR_RGB2GRAY)
    criteria = Criteria()
    return {each.tag_number for each in detector.detect(picture) if not criteria.flaw_of(each)}


def corners_of(world) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and the highest x and y of the tags and tables."""
    points = [tag.centre[:2] for tag in world.tags.values()]
    points += [corner for x0, y0, x1, y1 in world.tables for corner in ((x0, y0), (x1, y1))]
    return np.min(points, axis=0), np.max(points, axis=0)


def faces_outwards(tag: Tag, tables: list, middle: np.ndarray) -> bool:
    """Return whether a tag faces away from its nearest table, or to the middle without tables."""
    front, back = (tag.centre[:2] + turn * STEP_M * tag.out[:2] for turn in (1, -1))
    if not tables:
        return np.linalg.norm(front - middle) <= np.linalg.norm(back - middle)
    nearest = min(tables, key=lambda table: table.distance_m(*tag.centre[:2]))
    before, behind = nearest.distance_m(*front), nearest.distance_m(*back)
    return before > behind or before == behind == 0.0  # the latter in the middle of a table


def check_approaches(
    world, detector: TagDetector, layout, radius_m: float, side_m: float, views: Views
) -> bool:
    """Return whether each tag is read from its approach pose, with the camera along the robot's x axis."""
    poses = find_approaches(layout, ViewingLimits(radius_m)).poses
    missing = []
    for tag_id, pose in poses.items():
        eye = np.array([pose.x, pose.y, TAG_HEIGHT_M])
        ahead = np.array([math.cos(pose.yaw), math.sin(pose.yaw), 0.0])
        if int(tag_id) not in seen_from(world, detector, eye, eye + ahead):
            missing.append(tag_id)
        views.count()
    names = f', not {", ".join(missing)}' if missing else ''
    views.clear()
    print(
        f'{100 * side_m:g} cm, approach poses of a robot of radius {radius_m:.2f} m:'
        f' {len(poses) - len(missing)} of {len(poses)} read{names}',
        flush=True,
    )
    return not missing


def check(tag_file: str, side_m: float, folder: Path) -> bool:
    """Make a world and check it; print a line for each setting; return whether it is right."""
    sdf_file, layout = make_world(folder / f'{side_m:g}', tag_file, side_m)
    world = open_world(sdf_file)
    places = {number: tuple(tag.centre[:2]) for number, tag in world.tags.items()}
    is_right = places == {int(tag_id): (tag.x, tag.y) for tag_id, tag in layout.tags.items()}
    tables = tables_of(layout)
    is_right &= len(tables) == len(world.tables) and np.allclose(tables, world.tables, rtol=0, atol=SAME_M)
    low, high = corners_of(world)
    is_right &= all(faces_outwards(tag, tables, (low + high) / 2) for tag in world.tags.values())
    print(
        f'{100 * side_m:g} cm: {len(places)} tags and {len(world.tables)} tables,'
        f' {"where" if is_right else "NOT where"} the layout has them'
    )
    detector = TagDetector()
    settings = len(DISTANCES_M) * len(ANGLES_DEGREES) + len(RADII_M) + 1
    views = Views(settings * len(world.tags))
    low, high = low - MARGIN_M, high + MARGIN_M

    def can_stand(eye) -> bool:
        return (
            all(low < eye[:2])
            and all(eye[:2] < high)
            and all(each.distance_m(*eye[:2]) > ROBOT_RADIUS_M for each in tables)
        )

    for distance_m in DISTANCES_M:
        for angle_degrees in ANGLES_DEGREES:
            read, free = set(), 0
            for number, tag in world.tags.items():
                eyes = [viewpoint(tag, distance_m, turn * angle_degrees) for turn in (1, -1)]
                # Where a robot cannot stand, a picture from above the tables counts, from either side.
                standing = [eye for eye in eyes if can_stand(eye)]
                free += bool(standing)
                are_read = [number in seen_from(world, detector, eye, tag.centre) for eye in standing or eyes]
                if all(are_read) if standing else any(are_read):
                    read.add(number)
                views.count()
            missing = sorted(set(world.tags) - read)
            is_right &= not missing
            setting = f'{100 * side_m:g} cm, {distance_m:g} m, {angle_degrees}°'
            names = f', not {", ".join(map(str, missing))}' if missing else ''
            share = f'{len(read)} of {len(world.tags)} read{names}'
            views.clear()
            print(f'{setting}: {share} (a robot can stand there at {free})', flush=True)
    for radius_m in RADII_M:
        is_right &= check_approaches(world, detector, layout, radius_m, side_m, views)
    behind = []
    for number, tag in world.tags.items():
        if number in seen_from(world, detector, tag.centre - DISTANCES_M[0] * tag.out, tag.centre):
            behind.append(number)
        views.count()
    views.clear()
    print(f'{100 * side_m:g} cm, from behind: {len(behind)} of {len(world.tags)} read')
    return is_right and not behind


def main(arguments: list[str] | None = None) -> int:
    """Check the world with both sizes of tags."""
    parser = argparse.ArgumentParser(prog='check_world', description='Check the SDF world with Drake.')
    parser.add_argument('--tag-file', default='', metavar='FILE', help="default: the simulator's own")
    options = parser.parse_args(arguments)
    try:
        with tempfile.TemporaryDirectory(prefix='check_world-') as folder:
            results = [check(options.tag_file, side_m, Path(folder)) for side_m in SIDES_M]
    except OneLineError as error:
        print(f'check_world: {error}', file=sys.stderr)
        return 2
    print('the world is right' if all(results) else 'the world is WRONG')
    return 0 if all(results) else 1


if __name__ == '__main__':
    sys.exit(main())
