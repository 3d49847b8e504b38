"""Draw what the camera saw, and the verdict. Does not import ROS."""

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from lupin_tag_confirmation.confirmation import Verdict
from lupin_tag_confirmation.settings import Criteria

GOOD, FLAWED, OTHER = (60, 220, 60), (255, 150, 0), (90, 160, 255)
ASKED, PAPER = (255, 255, 255), (0, 0, 0)
BAR_PIXELS, FONT_PIXELS = 42, 15


def draw(verdict: Verdict, tag_number: int, criteria: Criteria) -> np.ndarray:
    """
    Return the picture of a verdict as RGB, uint8 of the shape (height, width, 3).

    Each tag has its outline and id: green if it counts, orange if it does not, blue for another id. A bar at
    the top shows which tag is looked for, and the verdict.
    """
    picture = Image.fromarray(verdict.sight.picture).convert('RGB')
    pen = ImageDraw.Draw(picture)
    pen.font = _font()
    for each in verdict.sight.detections:
        is_expected = each.tag_number == tag_number
        colour = (FLAWED if criteria.flaw_of(each) else GOOD) if is_expected else OTHER
        corners = [(float(x), float(y)) for x, y in each.corners]
        pen.line([*corners, corners[0]], fill=colour, width=4)
        (left, top), (_, bottom) = np.min(corners, axis=0), np.max(corners, axis=0)
        border = (bottom - top) / 8  # white, one of the tag's modules wide
        label = f'tag id {each.tag_number}'
        if is_expected:
            label += f': decision margin {each.decision_margin:.0f}, {criteria.min_decision_margin:g} needed'
        if is_expected and each.hamming:
            label += f', hamming {each.hamming}'
        width, height = pen.getfont().getmask(label).size  # textbbox of Pillow 9.0 refuses its default font
        left = max(min(float(left), picture.width - width - 2.0), 0.0)
        y = min(float(bottom + border) + 6, picture.height - height - 4)
        pen.rectangle((left, y, left + width + 1, y + height + 3), fill=PAPER)
        pen.text((left, y), label, fill=colour)
    pen.rectangle((0, 0, picture.width, BAR_PIXELS), fill=PAPER)
    pen.text((4, 3), f'camera image: looking for tag id {tag_number}', fill=ASKED)
    reason = verdict.reason.removeprefix(f'tag {tag_number}: ')
    answer, colour = (f'not confirmed; {reason}', FLAWED) if reason else ('confirmed', GOOD)
    pen.text((4, 3 + BAR_PIXELS // 2), answer, fill=colour)
    return np.asarray(picture)


def _font():
    try:
        return ImageFont.load_default(FONT_PIXELS)
    except TypeError:  # Pillow 9.0 of Ubuntu 22.04 has one size
        return ImageFont.load_default()
