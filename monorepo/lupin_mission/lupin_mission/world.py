"""Read the tags of an SDF world as data. Does not import ROS."""

import re
from xml.etree import ElementTree

from lupin_greenhouse_bridge.errors import StartUpError, escaped
from lupin_greenhouse_bridge.simulator.files import read_text
from lupin_greenhouse_bridge.simulator.layout import natural_order
from lupin_planning.walls import parse_numbers

TAG_MODEL = re.compile(r'tag_(0|[1-9][0-9]*)')


def read_world(world_file: str) -> dict[str, tuple[float, float]]:
    """
    Return x and y in metres of each model `tag_<id>` of an SDF world, by tag id, in numeric order.

    Raises StartUpError if the file is not such a world.
    """
    where = f"world_file '{escaped(world_file, 500)}'"
    text = read_text(world_file, where)
    try:
        world = ElementTree.fromstring(text)  # noqa: S314 - expat limits the expansion of entities
    except ElementTree.ParseError as error:
        raise StartUpError(
            f'{where} is not an SDF world ({error}): use a world made by generate_world'
        ) from error
    positions: dict[str, tuple[float, float]] = {}
    for model in world.iterfind('.//world//model'):
        match = TAG_MODEL.fullmatch(model.get('name', ''))
        if not match:
            continue
        tag_id, shown = match[1], f'tag_{escaped(match[1], 40)}'
        if tag_id in positions:
            raise StartUpError(f'{where} has the model {shown} twice: make it again with generate_world')
        coordinates = parse_numbers(model.findtext('pose', ''))
        if len(coordinates) < 2:
            raise StartUpError(f'{where}: the model {shown} has no pose of finite numbers: make it again')
        positions[tag_id] = coordinates[0], coordinates[1]
    if not positions:
        raise StartUpError(f'{where} has no model tag_<id>: use a world made by generate_world')
    return {tag_id: positions[tag_id] for tag_id in sorted(positions, key=natural_order)}
