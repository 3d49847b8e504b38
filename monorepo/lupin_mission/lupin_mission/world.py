"""Read the tags of an SDF world as data. Does not import ROS."""

import math
import re
import stat
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

from lupin_greenhouse_bridge.errors import StartUpError, escaped

LARGEST_FILE_BYTES = 64 * 2**20
TAG_MODEL = re.compile(r'tag_(0|[1-9][0-9]*)')


def read_world(world_file: str) -> dict[str, tuple[float, float]]:
    """
    Return x and y in metres of each model `tag_<id>` of an SDF world, by tag id, in numeric order.

    Raises StartUpError if the file is not such a world, or has a document type, which could declare entities.
    """
    where = f"world_file '{escaped(world_file, 500)}'"
    try:
        data = _content(Path(world_file), where)
        _refuse_document_type(data)
        worlds = list(ElementTree.fromstring(data).iter('world'))  # noqa: S314 - checked above
    except OSError as error:
        raise StartUpError(f'{where} cannot be read: {error.strerror}: name an SDF world') from error
    except (ValueError, LookupError, expat.ExpatError, ElementTree.ParseError, RecursionError) as error:
        raise StartUpError(
            f'{where} is not an SDF world ({error}): use a world made by generate_world'
        ) from error
    positions: dict[str, tuple[float, float]] = {}
    for model in (model for world in worlds for model in world.iter('model')):
        match = TAG_MODEL.fullmatch(model.get('name') or '')
        if not match:
            continue
        number, shown = match[1], f'tag_{escaped(match[1], 40)}'
        if number in positions:
            raise StartUpError(f'{where} has the model {shown} twice: make it again with generate_world')
        try:
            x, y = map(float, (model.findtext('pose') or '').split()[:2])
        except ValueError as error:
            raise StartUpError(f'{where}: the model {shown} has no pose: make it again') from error
        if not (math.isfinite(x) and math.isfinite(y)):
            raise StartUpError(f'{where}: the pose of {shown} is not finite: make it again')
        positions[number] = (x, y)
    if not positions:
        raise StartUpError(f'{where} has no model tag_<id>: use a world made by generate_world')
    in_order = sorted(positions, key=lambda number: (len(number), number))  # int() refuses 5,000 digits.
    return {number: positions[number] for number in in_order}


def _content(path: Path, where: str) -> bytes:
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):  # Reading a pipe would wait, and /dev/zero is endless.
        raise StartUpError(f'{where} is not a regular file: name an SDF world')
    if status.st_size > LARGEST_FILE_BYTES:
        raise StartUpError(f'{where} has more than {LARGEST_FILE_BYTES // 2**20} MiB: name an SDF world')
    return path.read_bytes()


def _refuse_document_type(data: bytes) -> None:
    """Raise ValueError for XML with a document type, which alone can declare entities."""

    def refuse(*_arguments: object) -> None:
        raise ValueError('it has a document type')

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    parser.Parse(data, True)
