# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Read approach_overrides.yaml: the values of poses that a team sets by hand. Does not import ROS."""

from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple

from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.simulator.json_yaml import number, read_yaml

_EXAMPLE = 'such as {overrides: {"7": {yaw: 1.57, standoff: 0.4}}}'
_LIMITS = {
    'yaw': {'unit': 'radians', 'smallest': -10.0, 'largest': 10.0},
    'standoff': {'unit': 'metres', 'smallest': 0.2, 'largest': 1.5},
    'goal_x': {'unit': 'metres'},
    'goal_y': {'unit': 'metres'},
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
    data = _mapping(read_yaml(path, where, f'a mapping, {_EXAMPLE}'), ('overrides',), path, where)
    found, warnings = {}, []
    for tag_id, each in _mapping(data.get('overrides'), None, path, where).items():
        here = f"{where}: tag '{escaped(str(tag_id), 64)}'"
        values = _mapping(each, _LIMITS, path, here, 'overrides', tag_id)
        override = Override(**{key: float(number(values, key, here, **_LIMITS[key])) for key in values})
        if str(tag_id) in layout_ids:
            found[str(tag_id)] = override
        else:
            warnings.append(f'{here} is not in the layout: its override has no effect')
    return found, warnings


def _mapping(data, keys: Collection[str] | None, path: str | Path, where: str, *parents) -> dict:
    """Return a mapping with these keys, {} for None; raises StartUpError for anything else."""
    data = {} if data is None else data
    if not isinstance(data, dict):
        raise StartUpError(f'{where}: is not a mapping, {_EXAMPLE}')
    for key in data:
        if keys is not None and key not in keys:
            raise StartUpError(
                f"{where}: line {_line_of(path, *parents, key)}: unknown key '{escaped(str(key), 64)}':"
                f' use {", ".join(keys)}'
            )
    return data


def _line_of(path: str | Path, *keys) -> int:
    """Return the line number, in a YAML file, of the last of these keys, each in the one before."""
    import yaml  # imported here: read_yaml has found it

    # JSON may be indented with tabs, YAML may not.
    name = node = yaml.compose(Path(path).read_text(encoding='utf-8').replace('\t', ' '))
    for key in keys:
        name, node = next((pair for pair in node.value if pair[0].value == str(key)), (name, node))
    return name.start_mark.line + 1
