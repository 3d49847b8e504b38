"""
Draw what confirm_tag publishes on ~/seen at the wrong tag, for the page of lupin_tag_confirmation.

    make figure
"""

import sys
from pathlib import Path

import numpy as np
from figure import draw_or_check, hash_of, parser_of
from lupin_simulation import pinhole_camera
from lupin_tag_confirmation import drawing
from lupin_tag_confirmation.confirmation import Confirmer, Frame, Moment, Sight
from lupin_tag_confirmation.detector import TagDetector
from lupin_tag_confirmation.settings import Settings
from PIL import Image

COMMITTED = Path(__file__).resolve().parents[2] / 'monorepo/lupin_tag_confirmation/doc/seen.png'
TAG, EXPECTED_TAG = 7, 8


def draw() -> Image.Image:
    """Return the picture."""
    camera, random = pinhole_camera.PinholeCamera(width=480, height=300), np.random.default_rng(TAG)
    scene = camera.scene_of_tag(TAG, random, distance_m=0.2, angle_degrees=35.0)
    picture = camera.expose(scene, random, blur_pixels=0.5, noise_levels=5.0)
    settings, now = Settings(), Moment(0.0, 0.0)
    confirmer, sight = Confirmer(settings), Sight(TagDetector().detect(picture), picture)
    for _ in range(settings.min_frames):
        confirmer.add(Frame(lambda: sight, *now))
    while confirmer.choose(now, now):
        pass
    verdict = confirmer.judge(EXPECTED_TAG, now, now)
    return Image.fromarray(drawing.draw(picture, sight.detections, EXPECTED_TAG, verdict.reason, settings))


def main(arguments: list[str] | None = None) -> int:
    """Draw or check; exit code 0: done, 1: not up to date."""
    is_check = parser_of('seen', __doc__).parse_args(arguments).check
    code = (__file__, drawing.__file__, pinhole_camera.__file__)
    fingerprint = hash_of(*(Path(file).read_bytes() for file in code))
    return draw_or_check('make figure', {COMMITTED: (fingerprint, draw)}, is_check=is_check)


if __name__ == '__main__':
    sys.exit(main())
