"""The detector on rendered pictures: it finds the tag."""

import numpy as np
import pytest
from lupin_simulation.pinhole_camera import PinholeCamera
from lupin_tag_confirmation.detector import TagDetector
from lupin_tag_confirmation.settings import Settings

CAMERA = PinholeCamera()
SHARP, NOISY, BLURRED = {}, {'noise_levels': 15.0}, {'blur_pixels': 1.0}


@pytest.mark.parametrize(
    ('distance_m', 'angles_degrees', 'conditions'),
    [
        (0.5, (0, 30, 45, 60), (SHARP, NOISY, BLURRED, NOISY | BLURRED)),
        (1.5, (0, 30, 45), (SHARP, NOISY)),
    ],
)
def test_4_cm_tags_are_found_where_the_robot_stands(distance_m, angles_degrees, conditions):
    """Two ids; doc/confirm_tag.md of lupin_tag_confirmation has 30, also with blur at 1 m."""
    detector, settings = TagDetector(), Settings()
    for tag_number in (1, 21):
        for angle_degrees in angles_degrees:
            random = np.random.default_rng(tag_number)
            scene = CAMERA.scene_of_tag(tag_number, random, distance_m, angle_degrees)
            for condition in conditions:
                picture = CAMERA.expose(scene, random, **condition)
                found = [tag.tag_number for tag in detector.detect(picture) if not tag.flaw(settings)]
                assert found == [tag_number], (angle_degrees, condition)
