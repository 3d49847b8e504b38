"""Draw what the camera saw, and the verdict. Does not import ROS."""

import textwrap
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from lupin_tag_confirmation.confirmation import Detection
from lupin_tag_confirmation.settings import Settings

GOOD, FLAWED, OTHER = (60, 220, 60), (255, 150, 0), (90, 160, 255)
QUIET, PAPER = (210, 210, 210), (0, 0, 0)
USUAL_SIZE, SMALLEST_SCALE = (540, 320), 0.68  # a larger picture has larger texts
TITLE_PIXELS, FONT_PIXELS, PAD_PIXELS, SPACING, MOST_LINES = 23, 19, 6, 1.25, 2
LINE_PIXELS, FINER = 2.4, 4  # the width of an outline; it is drawn FINER times larger, then reduced
# Points in a square with sides of 1.
TICK, CROSS = ((0, 0.5), (0.35, 0.9), (1, 0.1)), ((0, 0), (1, 1), (0.5, 0.5), (0, 1), (1, 0))


def draw(
    picture: np.ndarray, detections: list[Detection], expected_number: int, reason: str, settings: Settings
) -> np.ndarray:
    """
    Return a picture with its detections and the verdict as RGB, uint8 of the shape (height, width, 3).

    Each tag has its outline and id: green if it counts, orange if it does not, blue for another id. A bar at
    the top shows the verdict, and the reason why the tag is not confirmed, if there is one.
    """
    image = Image.fromarray(picture).convert('RGB')
    pen = ImageDraw.Draw(image)
    scale = max(SMALLEST_SCALE, min(np.divide(image.size, USUAL_SIZE)))
    large, small, pad = (round(scale * pixels) for pixels in (TITLE_PIXELS, FONT_PIXELS, PAD_PIXELS))
    row, top = round(SPACING * small), pad + round(SPACING * large)
    pen.font = _font(small)
    problem = reason.removeprefix(f'tag {expected_number}: ')
    text = problem or f'AprilTag id {expected_number} is in the camera image'
    characters = (image.width - 3 * pad) * len(text) // _width(pen, text)
    text = textwrap.fill(text, max(8, characters), max_lines=MOST_LINES, placeholder=' ...')
    bar = top + row * (1 + text.count('\n')) + pad // 2
    labels, taken = [], [np.array([0.0, 0.0, image.width, bar])]  # boxes of left, top, right and bottom
    for detection in sorted(detections, key=lambda detection: detection.tag_number != expected_number):
        corners = detection.corners
        label, colour = _label_of(detection, expected_number, settings)
        _stroke(image, corners[[0, 1, 2, 3, 0]], round(scale * LINE_PIXELS), colour)
        border = np.ptp(corners[:, 1]) / 8  # the white border is one module wide
        taken.append(np.append(corners.min(axis=0) - border, corners.max(axis=0) + border))
        labels.append((label, colour))
    for (label, colour), tag_box in zip(labels, taken[1:], strict=True):
        size = np.array([max(_width(pen, line) for line in label) + 2 * pad, len(label) * row + pad])
        taken.append(_place(size, tag_box, pad, np.array([0, bar]), image.size - size, taken))
        x, y = taken[-1][:2]
        pen.rectangle(tuple(taken[-1] - (0, 0, 1, 1)), fill=PAPER)
        for number, line in enumerate(label):
            pen.text((x + pad, y + pad / 2 + number * row), line, fill=colour)
    pen.rectangle((0, 0, image.width, bar - 1), fill=PAPER)
    pen.text((2 * pad, top), text, fill=QUIET, spacing=row - small)
    mark, colour = (CROSS, FLAWED) if problem else (TICK, GOOD)
    _stroke(image, np.add(np.multiply(mark, 0.7 * large), (2 * pad, 1.9 * pad)), scale * 3.5, colour)
    pen.font = _font(large)
    answer = f'tag {expected_number} {"not " if problem else ""}confirmed'
    for bolder in range(1 + round(scale) * hasattr(pen.font, 'size')):  # not the small font of Pillow 9.0
        pen.text((2.5 * pad + large + bolder, pad), answer, fill=colour)
    return np.asarray(image)


def _label_of(
    detection: Detection, expected_number: int, settings: Settings
) -> tuple[list[str], tuple[int, int, int]]:
    """Return the lines of a detection's label, and its colour."""
    if detection.tag_number != expected_number:
        return [f'tag {detection.tag_number}, not {expected_number}'], OTHER
    contrast = f'contrast {detection.decision_margin:.0f} (needs {settings.min_decision_margin:g})'
    errors = [f'hamming {detection.hamming}'] if detection.hamming else []
    return [f'tag {detection.tag_number}', contrast, *errors], FLAWED if detection.flaw(settings) else GOOD


def _place(size: Any, tag_box: Any, gap: int, least: Any, most: Any, taken: list[Any]) -> Any:
    """Return the box of a label: below, above or beside its tag, where it overlaps the taken boxes least."""
    (left, above, right, below), (width, height) = tag_box, size
    corners = [(x, y) for y in (below + gap, above - gap - height) for x in (left, right - width)]
    corners += [(right + gap, above), (left - gap - width, above)]
    starts = np.clip(corners, least, np.maximum(least, most))[:, None]
    others = np.array(taken)
    common = np.minimum(starts + size, others[:, 2:]) - np.maximum(starts, others[:, :2])
    start = starts[common.clip(0).prod(axis=2).sum(axis=1).argmin(), 0]
    return np.append(start, start + size)


def _stroke(image: Image.Image, points: Any, width: float, colour: tuple[int, int, int]) -> None:
    """Draw a smooth line through points."""
    ends = points.min(axis=0) - width, points.max(axis=0) + width
    first, last = np.clip(ends, 0, np.subtract(image.size, 1)).astype(int)
    mask = Image.new('L', tuple((FINER * (last - first + 1)).tolist()))
    corners = [tuple(corner) for corner in FINER * (points - first + 0.5)]
    ImageDraw.Draw(mask).line(corners, 255, round(FINER * width), 'curve')
    image.paste(colour, tuple(first.tolist()), mask.reduce(FINER))


def _width(pen: Any, text: str) -> int:
    return int(pen.getfont().getmask(text).size[0])


def _font(pixels: int) -> Any:
    try:
        return ImageFont.load_default(pixels)
    except TypeError:  # Pillow 9.0 of Ubuntu 22.04 has one size, which textbbox refuses
        return ImageFont.load_default()
