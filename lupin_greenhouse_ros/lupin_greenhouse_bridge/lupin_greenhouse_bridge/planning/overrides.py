# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Read approach_overrides.yaml: the values of poses that a team sets by hand. Does not import ROS."""

from collections.abc import Collection
from pathlib import Path
from typing import Any, NamedTuple

from lupin_greenhouse_bridge.errors import escaped
from lupin_greenhouse_bridge.simulator.json_yaml import mapping_of, number, read_yaml, refuse_unknown_keys

EXAMPLE = '{overrides: {"7": {yaw: 3.14, standoff: 0.4}}}'
# The unit of each key, and its smallest and largest value.
_LIMITS: dict[str, tuple[Any, ...]] = {
    'yaw': ('radians', -10.0, 10.0),
    'standoff': ('metres', 0.2, 1.5),
    'goal_x': ('metres',),
    'goal_y': ('metres',),
}


class Override(NamedTuple):
    """The values that a team sets by hand for one tag, in the layout's frame; None is computed."""

    yaw: float | None = None  # of the robot, in radians
    standoff: float | None = None  # metres to the tag
    goal_x: float | None = None
    goal_y: float | None = None


def read_overrides(path: str | Path, layout_ids: Collection[str]) -> tuple[dict[str, Override], list[str]]:
    """Return the overrides of a file by tag id, and a warning for each unknown id; raises StartUpError."""
    where = f"approach overrides '{escaped(str(path), 500)}'"
    data = read_yaml(path, where, f'a mapping, such as {EXAMPLE}')
    refuse_unknown_keys(data, ['overrides'], where, EXAMPLE)
    overrides = mapping_of(data, 'overrides', where, EXAMPLE) if data.get('overrides') else {}
    found: dict[str, Override] = {}
    warnings = [] if any(overrides.values()) else [f'{where}: holds no overrides']
    for tag_id, each in overrides.items():
        here = f"{where}: tag '{escaped(str(tag_id), 64)}'"
        values = {} if each is None else mapping_of(overrides, tag_id, where, EXAMPLE)
        refuse_unknown_keys(values, _LIMITS, here, EXAMPLE)
        override = Override(**{key: float(number(values, key, here, *_LIMITS[key])) for key in values})
        if str(tag_id) in layout_ids:
            found[str(tag_id)] = override
            if len(missing := {'goal_x', 'goal_y'} - values.keys()) == 1:
                warnings.append(f'{here}: {missing.pop()} is missing: it is computed')
        else:
            warnings.append(f'{here} is not in the layout: its override has no effect')
    return found, warnings
