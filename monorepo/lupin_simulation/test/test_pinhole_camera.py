"""The tags that the detector finds in the pictures: all that are in view, and no others."""

import itertools
import math

import numpy as np
import pytest
from lupin_planning.poses import PoseInPlane
from lupin_planning.tag_poses import TagPose
from lupin_simulation.pinhole_camera import TAG_SIDE_M, PinholeCamera
from lupin_tag_confirmation.detector import TagDetector
from lupin_tag_confirmation.settings import Settings

CAMERA = PinholeCamera()
DETECTOR = TagDetector()
SOUTHWARDS = TagPose(2.0, 3.0, -math.pi / 2)
CENTRE_X, CENTRE_Y = CAMERA.width / 2, CAMERA.height / 2


def numbers_and_corners(picture: np.ndarray) -> dict[int, np.ndarray]:
    """Return the corners of the tags that confirm_tag would accept, by number."""
    return {tag.tag_number: tag.corners for tag in DETECTOR.detect(picture) if not tag.flaw(Settings())}


def seen_from(x: float, y: float, yaw: float, **tags: TagPose) -> dict[int, np.ndarray]:
    """Return the corners of the tags in view from a pose, by number; t7 is the tag of number 7."""
    by_number = {int(name.removeprefix('t')): tag for name, tag in tags.items()}
    random = np.random.default_rng(0)
    scene = CAMERA.scene_from(PoseInPlane(x, y, yaw), by_number, random)
    return numbers_and_corners(CAMERA.expose(scene, random, blur_pixels=0.7))


def before(
    tag: TagPose, distance_m: float, angle_degrees: float, yaw_off_degrees: float = 0.0
) -> PoseInPlane:
    """Return a pose at this distance and angle to the normal of a tag, which looks at it but for yaw_off."""
    direction = tag.facing + math.radians(angle_degrees)
    x, y = tag.x + distance_m * math.cos(direction), tag.y + distance_m * math.sin(direction)
    return PoseInPlane(x, y, direction + math.pi + math.radians(yaw_off_degrees))


SHARP, NOISY, BLURRED = {}, {'noise_levels': 15.0}, {'blur_pixels': 1.0}


@pytest.mark.parametrize(
    ('distance_m', 'angles_degrees', 'conditions'),
    [(0.5, (0, 30, 45, 60), (SHARP, NOISY, BLURRED, NOISY | BLURRED)), (1.5, (0, 30, 45), (SHARP, NOISY))],
)
def test_4_cm_tags_are_found_where_the_robot_stands(distance_m, angles_degrees, conditions):
    """Two ids; doc/confirm_tag.md of lupin_tag_confirmation has 30, also with blur at 1 m."""
    for tag_number, angle_degrees in itertools.product((1, 21), angles_degrees):
        random = np.random.default_rng(tag_number)
        scene = CAMERA.scene_of_tag(tag_number, random, distance_m, angle_degrees)
        for condition in conditions:
            found = numbers_and_corners(CAMERA.expose(scene, random, **condition))
            assert list(found) == [tag_number], (angle_degrees, condition)


@pytest.mark.parametrize('facing', [-math.pi / 2, math.pi, 2.5])
@pytest.mark.parametrize(
    ('distance_m', 'angle_degrees'), [(0.3, 0), (0.3, -45), (0.5, 30), (1.0, 45), (1.0, -45)]
)
def test_a_tag_is_read_in_the_middle_of_a_picture_that_is_taken_towards_it(facing, distance_m, angle_degrees):
    tag = TagPose(2.0, 3.0, facing)
    ((number, corners),) = seen_from(*before(tag, distance_m, angle_degrees), t7=tag).items()
    assert number == 7
    assert np.allclose(corners.mean(axis=0), (CENTRE_X, CENTRE_Y), atol=3.0)


@pytest.mark.parametrize('yaw_off_degrees', [-15.0, 0.0, 10.0])
def test_a_tag_is_as_large_as_its_distance_says_and_left_of_the_middle_for_a_robot_that_looks_to_its_right(
    yaw_off_degrees,
):
    (corners,) = seen_from(*before(SOUTHWARDS, 0.5, 0.0, yaw_off_degrees), t7=SOUTHWARDS).values()
    shift = CAMERA.focal_length_pixels * math.tan(math.radians(yaw_off_degrees))
    assert corners.mean(axis=0) == pytest.approx((CENTRE_X + shift, CENTRE_Y), abs=3.0)
    side = CAMERA.focal_length_pixels * TAG_SIDE_M / 0.5
    assert np.ptp(corners[:, 1]) == pytest.approx(side, abs=1.5 + abs(shift) / 20)  # in perspective


@pytest.mark.parametrize(
    'pose',
    [
        before(SOUTHWARDS, 0.5, 0.0, 90.0),
        before(SOUTHWARDS, 0.5, 0.0, 180.0),
        before(SOUTHWARDS, 0.5, 180.0),
        before(SOUTHWARDS, 0.5, 89.0),
        before(SOUTHWARDS, 4.0, 0.0),
        before(SOUTHWARDS, 0.03, 0.0),
        (*before(SOUTHWARDS, 0.5, 0.0)[:2], 0.0),
    ],
    ids=['beside', 'with its back to it', 'from behind', 'edge on', 'far', 'too near', 'yaw 0'],
)
def test_a_robot_that_stands_wrongly_does_not_see_its_tag(pose):
    assert seen_from(*pose, t7=SOUTHWARDS) == {}


@pytest.mark.parametrize('facing', [-math.pi / 2, math.pi / 2], ids=['front', 'back'])
def test_a_nearer_tag_hides_the_one_behind_it(facing):
    nearer = TagPose(2.0, 2.8, facing)
    eye = before(SOUTHWARDS, 0.6, 0.0)
    assert 7 in seen_from(*eye, t7=SOUTHWARDS)
    assert 7 not in seen_from(*eye, t7=SOUTHWARDS, t8=nearer)
    assert 7 not in seen_from(*eye, t8=nearer, t7=SOUTHWARDS)


def test_all_tags_in_view_are_in_the_picture():
    beside = {'t8': SOUTHWARDS._replace(x=1.9), 't9': SOUTHWARDS._replace(x=2.1)}
    far = TagPose(9.0, 3.0, 0.0)
    assert set(seen_from(*before(SOUTHWARDS, 0.5, 0.0), t7=SOUTHWARDS, **beside, t10=far)) == {7, 8, 9}
