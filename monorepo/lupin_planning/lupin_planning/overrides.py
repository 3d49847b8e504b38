"""Read approach_overrides.yaml: the poses that a team sets by hand. Does not import ROS."""

from collections.abc import Collection
from pathlib import Path

from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.simulator.files import read_yaml

from lupin_planning.poses import PoseInPlane
from lupin_planning.registration import POSE_LIMITS, Transform
from lupin_planning.values import mapping_of, number, refuse_unknown_keys

EXAMPLE = '{frame: layout, overrides: {"7": {x: 3.0, y: 7.4, yaw: 3.14}}}'
FRAMES = ('layout', 'map')


def read_overrides(
    path: str | Path, layout_ids: Collection[str], layout_in_map: Transform | None = None
) -> tuple[dict[str, PoseInPlane], list[str]]:
    """
    Return the poses of a file in the layout by tag id, and a warning for each unknown id.

    Raises StartUpError for a malformed file, and for poses in the map without the layout's place in it.
    """
    where = f"approach overrides '{escaped(str(path), 500)}'"
    data = read_yaml(path, where, f'a mapping, such as {EXAMPLE}')
    refuse_unknown_keys(data, ['frame', 'overrides'], where, EXAMPLE)
    frame = data.get('frame')
    if frame not in FRAMES:
        raise StartUpError(f'{where}: frame is {escaped(repr(frame), 60)}: must be layout or map')
    if frame == 'map' and layout_in_map is None:
        raise StartUpError(f'{where}: frame is map: set --layout-in-map to say where the layout lies in it')
    to_layout = layout_in_map.inverse() if frame == 'map' and layout_in_map else Transform()
    overrides = mapping_of(data, 'overrides', where, EXAMPLE)
    found: dict[str, PoseInPlane] = {}
    warnings = []
    for tag_id in overrides:
        here = f"{where}: tag '{escaped(str(tag_id), 64)}'"
        values = mapping_of(overrides, tag_id, where, EXAMPLE)
        refuse_unknown_keys(values, POSE_LIMITS, here, EXAMPLE)
        x, y, yaw = (number(values, key, here, *limits) for key, limits in POSE_LIMITS.items())
        if str(tag_id) in layout_ids:
            found[str(tag_id)] = PoseInPlane(*to_layout.point(x, y), to_layout.heading(yaw))
        else:
            warnings.append(f'{here} is not in the layout: its override has no effect')
    return found, warnings
