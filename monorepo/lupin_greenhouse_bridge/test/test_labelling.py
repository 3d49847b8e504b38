# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The places of labels beside what they name."""

import itertools

from lupin_greenhouse_bridge.planning.labelling import Box, place_labels


def shared_m2(one: Box, other: Box) -> float:
    """Return the common area of two boxes."""
    lengths_m = [
        min(a + a_size / 2, b + b_size / 2) - max(a - a_size / 2, b - b_size / 2)
        for a, a_size, b, b_size in zip(one[:2], one[2:], other[:2], other[2:], strict=True)
    ]
    return max(lengths_m[0], 0.0) * max(lengths_m[1], 0.0)


def test_a_thousand_labels_cover_no_dot_and_no_other_label():
    dots = [Box(float(x), float(y), 0.2, 0.2) for x in range(40) for y in range(25)]
    places = place_labels(dots, [(dot, 1.2, 0.3) for dot in dots])
    labels = [Box(*place, 1.2, 0.3) for place in places]
    near = (
        (a, b) for a, b in itertools.combinations(dots + labels, 2) if abs(a.x - b.x) + abs(a.y - b.y) < 1.5
    )
    assert sum(shared_m2(*each) for each in near) < 1e-9


def test_a_label_stays_within_the_walls_and_takes_the_nearest_place_that_is_free():
    room, dot = Box(1.0, 1.0, 2.0, 2.0), Box(1.9, 1.0, 0.2, 0.2)
    assert place_labels([dot], [(dot, 0.6, 0.2)], room) == [(1.5, 1.0)]
    assert place_labels([dot, Box(1.5, 1.0, 0.2, 0.2)], [(dot, 0.4, 0.2)], room) != [(1.6, 1.0)]
    assert place_labels([dot], [(dot, 0.6, 0.2)]) == [(2.3, 1.0)]
