"""
Draw what confirm_tag publishes on ~/seen at the wrong tag, for the page of lupin_tag_confirmation.

    make figure
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from figure import fingerprint_of, hash_of
from lupin_simulation import pinhole_camera
from lupin_tag_confirmation import drawing
from lupin_tag_confirmation.confirmation import Confirmer, Frame, Moment, Sight
from lupin_tag_confirmation.detector import TagDetector
from lupin_tag_confirmation.settings import Settings
from PIL import Image, PngImagePlugin

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


def fingerprint() -> str:
    """Return a hash of everything that the picture is drawn from."""
    return hash_of(
        *(Path(file).read_bytes() for file in (__file__, drawing.__file__, pinhole_camera.__file__))
    )


def main(arguments: list[str] | None = None) -> int:
    """Draw or check; exit code 0: done, 1: not up to date."""
    parser = argparse.ArgumentParser(prog='seen', description=(__doc__ or '').strip().splitlines()[0])
    parser.add_argument('--check', action='store_true', help='compare the committed picture; draw nothing')
    if parser.parse_args(arguments).check:
        is_stale = fingerprint_of(COMMITTED) != fingerprint()
        print(f'seen: {COMMITTED} is not up to date: make figure' if is_stale else 'seen: up to date')
        return int(is_stale)
    info = PngImagePlugin.PngInfo()
    info.add_text('Description', fingerprint())
    draw().save(COMMITTED, pnginfo=info)
    print(COMMITTED)
    return 0


if __name__ == '__main__':
    sys.exit(main())
