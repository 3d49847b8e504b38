"""Find places for labels beside what they name. Does not import ROS."""

from typing import NamedTuple


class Box(NamedTuple):
    """A rectangle in metres: its centre and its size."""

    x: float
    y: float
    width: float
    height: float

    def overlap(self, other: 'Box') -> float:
        """Return the common area of two rectangles."""
        wide = _shared(self.x, self.width, other.x, other.width)
        return wide * _shared(self.y, self.height, other.y, other.height)


def _shared(middle: float, length: float, other_middle: float, other_length: float) -> float:
    """Return the common length of two intervals."""
    end = min(middle + length / 2, other_middle + other_length / 2)
    return max(end - max(middle - length / 2, other_middle - other_length / 2), 0.0)


def place_labels(
    dots: list[Box], labels: list[tuple[Box, float, float]], room: Box | None = None
) -> list[tuple[float, float]]:
    """
    Return a place for each label beside its dot, where it covers no dot, no earlier label and no wall.

    Each label is given as its dot, its width and its height.
    """
    taken = list(dots)
    places = []
    for dot, width, height in labels:
        aside, above = (dot.width + width) / 2, (dot.height + height) / 2
        tries = [(aside, 0), (-aside, 0), (0, above), (0, -above)]
        tries += [(x * aside, y * above) for y in (0.7, -0.7, 1.0, -1.0) for x in (1, -1)]
        tries += [(2 * x, 2 * y) for x, y in tries]
        boxes = [Box(dot.x + dx, dot.y + dy, width, height) for dx, dy in tries]

        def cost(box: Box) -> float:
            outside = box.width * box.height - box.overlap(room) if room else 0.0
            return round(outside + sum(box.overlap(each) for each in taken), 4)  # the nearest of equals

        best = min(boxes, key=cost)
        taken.append(best)
        places.append((best.x, best.y))
    return places
