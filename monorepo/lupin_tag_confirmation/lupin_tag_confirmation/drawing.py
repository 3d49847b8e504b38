"""Draw what the camera saw, and the verdict. Does not import ROS."""

from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from lupin_tag_confirmation.confirmation import Detection
from lupin_tag_confirmation.settings import Settings

GOOD, FLAWED, OTHER = (60, 220, 60), (255, 150, 0), (90, 160, 255)
ASKED, PAPER = (255, 255, 255), (0, 0, 0)
USUAL_WIDTH, BAR_PIXELS, FONT_PIXELS, PAD_PIXELS = 540, 48, 15, 5  # a wider picture has larger texts
LINE_PIXELS, FINER = 4, 4  # of an outline: its width, and how much finer it is drawn than it is shown


def draw(
    picture: np.ndarray, detections: list[Detection], expected_number: int, reason: str, settings: Settings
) -> np.ndarray:
    """
    Return a picture with its detections and the verdict as RGB, uint8 of the shape (height, width, 3).

    Each tag has its outline and id: green if it counts, orange if it does not, blue for another id. A bar at
    the top shows which tag is looked for, and the reason why it is not confirmed, if there is one.
    """
    image = Image.fromarray(picture).convert('RGB')
    pen = ImageDraw.Draw(image)
    scale = max(1.0, image.width / USUAL_WIDTH)
    bar, pad = round(scale * BAR_PIXELS), round(scale * PAD_PIXELS)
    row = bar // 2 - pad
    pen.font = _font(round(scale * FONT_PIXELS))
    for each in detections:
        label, colour = [f'tag id {each.tag_number}, not {expected_number}'], OTHER
        if each.tag_number == expected_number:
            colour = FLAWED if each.flaw(settings) else GOOD
            margin, least = each.decision_margin, settings.min_decision_margin
            label = [f'tag id {each.tag_number}', f'contrast {margin:.0f} grey levels, {least:g} needed']
            label += [f'hamming {each.hamming}'] if each.hamming else []
        (left, top), (_, bottom) = ends = each.corners.min(axis=0), each.corners.max(axis=0)
        around = np.add(ends, [[-LINE_PIXELS], [LINE_PIXELS]])
        first, last = np.clip(around, 0, np.subtract(image.size, 1)).astype(int)
        outline = Image.new('L', tuple((FINER * (last - first + 1)).tolist()))
        corners = [tuple(corner) for corner in FINER * (each.corners - first + 0.5)]
        ImageDraw.Draw(outline).line([*corners, *corners[:2]], 255, FINER * LINE_PIXELS, 'curve')
        image.paste(colour, tuple(first.tolist()), outline.reduce(FINER))
        border = (bottom - top) / 8  # white, one of the tag's modules wide
        width = max(pen.getfont().getmask(line).size[0] for line in label)
        right, low = width + 2.0 * pad, float(len(label) * row + pad)
        x = max(min(float(left), image.width - right), 0.0)
        y = min(float(bottom + border) + 6 * scale, image.height - low)
        pen.rectangle((x, y, x + right, y + low), fill=PAPER)
        for number, line in enumerate(label):
            pen.text((x + pad, y + pad / 2 + number * row), line, fill=colour)
    pen.rectangle((0, 0, image.width, bar), fill=PAPER)
    pen.text((2 * pad, pad), f'camera image: looking for tag id {expected_number}', fill=ASKED)
    why = reason.removeprefix(f'tag {expected_number}: ')
    answer, colour = (f'not confirmed; {why}', FLAWED) if why else ('confirmed', GOOD)
    pen.text((2 * pad, bar // 2), answer, fill=colour)
    return np.asarray(image)


def _font(pixels: int) -> Any:
    try:
        return ImageFont.load_default(pixels)
    except TypeError:  # Pillow 9.0 of Ubuntu 22.04 has one size, which textbbox refuses
        return ImageFont.load_default()
