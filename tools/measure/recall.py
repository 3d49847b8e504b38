"""
Measure how often the camera's detector finds a tag, and how often it finds one that is not there.

Prints a table: AprilTag 3 with confirm_tag's default criteria beside OpenCV's ArUco detector with its own,
on the same rendered pictures of 640 x 480 pixels and a focal length of 600 pixels. Then come pictures without
the tag. The exit code is 1 if a goal is missed.
"""

import argparse
import itertools
import multiprocessing
import os
import statistics
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import cv2
import numpy as np
from apriltag import apriltag
from lupin_simulation import scene
from lupin_tag_confirmation.detector import TagDetector
from lupin_tag_confirmation.images import decoded_picture, grey_picture
from lupin_tag_confirmation.settings import Criteria
from shared import in_turns, print_head, print_row

SIDES_M = (0.04, 0.05)
DISTANCES_M = (0.2, 0.5, 0.8, 1.0, 1.25, 1.5)
ANGLES_DEGREES = (0, 30, 45, 60)
CONDITIONS = {
    'sharp': {},
    'blur 1 px': {'blur_pixels': 1.0},
    'noise 15': {'noise_levels': 15.0},
    'blur 1 px, noise 15': {'blur_pixels': 1.0, 'noise_levels': 15.0},
}
DECOYS_IN_ONE_GO = 250


def goal(side_m: float, distance_m: float, angle_degrees: float, condition: str) -> float:
    """Return the share of 4 cm tags that must be found; 0.0 if there is no goal."""
    if side_m != 0.04:
        return 0.0
    if distance_m <= 0.5:
        return 1.0
    if angle_degrees > 45:
        return 0.0
    if condition in ('sharp', 'noise 15') and distance_m <= 1.5:
        return 1.0
    return 0.95 if condition == 'blur 1 px' and distance_m <= 1.0 else 0.0


def opencv_detector():
    """Return OpenCV's detector of the family, with its own defaults, as a function from picture to ids."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    detector = cv2.aruco.ArucoDetector(dictionary, cv2.aruco.DetectorParameters())

    def detect(picture):
        _, numbers, _ = detector.detectMarkers(picture)
        return [] if numbers is None else numbers.ravel().tolist()

    return detect


def apriltag_detector():
    """Return the detector of confirm_tag with its default criteria, as a function from picture to ids."""
    criteria = Criteria()
    detector = TagDetector(criteria.max_hamming)
    return lambda picture: [
        seen.tag_number for seen in detector.detect(picture) if not criteria.flaw_of(seen)
    ]


def timed(detect, *arguments) -> tuple[float, list[int]]:
    """Return how many milliseconds a call takes, and what it returns."""
    started = time.perf_counter()
    found = detect(*arguments)
    return 1e3 * (time.perf_counter() - started), found


def one_row(task):
    """Return, for each condition, how many ids each detector finds, and the median milliseconds of each."""
    side_m, distance_m, angle_degrees, ids = task
    cv2.setNumThreads(1)
    camera = scene.Camera(tag_side_m=side_m)
    detectors = (apriltag_detector(), opencv_detector())
    counts, times_ms = [], ([], [])
    for condition in CONDITIONS.values():
        found = [0, 0]
        for tag_number in range(1, ids + 1):
            picture = camera.look_at(
                scene.marker(tag_number, module_pixels=30),
                np.random.default_rng(tag_number),
                distance_m=distance_m,
                angle_degrees=angle_degrees,
                **condition,
            )
            for index, detect in enumerate(detectors):
                milliseconds, numbers = timed(detect, picture)
                times_ms[index].append(milliseconds)
                found[index] += tag_number in numbers
        counts.append(found)
    return counts, list(map(statistics.median, times_ms))


def false_positives(first: int) -> tuple[int, int]:
    """Return the number of decoys that were taken for tag 7, and the number of other ids that were read."""
    detect = apriltag_detector()
    wrong = others = 0
    for number in range(first, first + DECOYS_IN_ONE_GO):
        is_clean = scene.DECOYS[number % len(scene.DECOYS)] != 'other ids'
        numbers = detect(scene.decoy(number, 7, np.random.default_rng(number)))
        wrong += bool(numbers) if is_clean else 7 in numbers
        others += bool(numbers) and not is_clean
    return wrong, others


def print_table(pool, ids: int) -> bool:
    """Print the table of recall; return whether every goal is met."""
    print(
        f'{ids} ids each; found by AprilTag 3 with the defaults of confirm_tag / by OpenCV {cv2.__version__}'
    )
    print()
    print_head('tag', 'distance', 'side', 'angle', *CONDITIONS, 'AprilTag 3', 'OpenCV')
    met = True
    tasks = list(itertools.product(SIDES_M, DISTANCES_M, ANGLES_DEGREES, [ids]))
    for (side_m, distance_m, angle_degrees, _), (counts, medians) in zip(
        tasks, pool.map(one_row, tasks), strict=True
    ):
        cells = []
        for condition, (ours, opencv) in zip(CONDITIONS, counts, strict=True):
            is_missed = ours / ids < goal(side_m, distance_m, angle_degrees, condition)
            met = met and not is_missed
            cells.append(f'{ours} / {opencv}' + (' **missed**' if is_missed else ''))
        side = scene.Camera(tag_side_m=side_m).side_pixels(distance_m)
        place = (f'{100 * side_m:g} cm', f'{distance_m:g} m', f'{side:.0f} px', f'{angle_degrees}°')
        print_row(*place, *cells, *(f'{median:.1f} ms' for median in medians))
    return met


def print_cost() -> None:
    """Print what an image message costs the node, compared with the bare call of the library."""
    library = apriltag('tag36h11', maxhamming=0, decimate=1.0)
    detect = TagDetector().detect
    picture = scene.Camera().look_at(scene.marker(7, module_pixels=30), np.random.default_rng(7))
    height, width = picture.shape
    colours = np.repeat(picture, 3).tobytes()
    _, jpeg = cv2.imencode('.jpg', picture)
    cases = {
        'the library alone': lambda: library.detect(picture),
        'mono8': lambda: detect(grey_picture('mono8', height, width, width, picture.data)),
        'rgb8': lambda: detect(grey_picture('rgb8', height, width, 3 * width, colours)),
        'JPEG': lambda: detect(decoded_picture(jpeg)),
    }
    rounds = in_turns([partial(timed, call) for call in cases.values()], 60)
    medians = {
        name: statistics.median(duration for duration, _ in calls)
        for name, calls in zip(cases, zip(*rounds, strict=True), strict=True)
    }
    print(f'one picture of {width} x {height}: ' + ', '.join(f'{k} {v:.1f} ms' for k, v in medians.items()))


def main(arguments: list[str] | None = None) -> int:
    """Print both tables; return the exit code."""
    parser = argparse.ArgumentParser(prog='recall', description=__doc__.strip().splitlines()[0])
    parser.add_argument('--ids', type=int, default=30, help='ids in each cell (default: %(default)s)')
    parser.add_argument('--decoys', type=int, default=20_000, help='pictures without the tag')
    options = parser.parse_args(arguments)
    # Not forked: OpenCV's threads do not survive a fork.
    with ProcessPoolExecutor(os.cpu_count(), multiprocessing.get_context('spawn')) as pool:
        met = print_table(pool, options.ids)
        results = list(pool.map(false_positives, range(0, options.decoys, DECOYS_IN_ONE_GO)))
    wrong, others = map(sum, zip(*results, strict=True))
    decoys = len(results) * DECOYS_IN_ONE_GO
    print()
    print(f'pictures without the tag ({", ".join(scene.DECOYS)}): {decoys:,}, false positives: {wrong}')
    print(f'of the {decoys // len(scene.DECOYS):,} with another id, {others:,} were read as that')
    print_cost()
    print('goals: ' + ('met' if met and not wrong else 'missed'))
    return 0 if met and not wrong else 1


if __name__ == '__main__':
    sys.exit(main())
