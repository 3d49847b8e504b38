"""
Write the world: SDFormat 1.6, and for each tag an OBJ mesh with its texture. Does not import ROS.

The functions are named after the elements that they return.
"""

import io
import math
from xml.etree.ElementTree import Element, indent, tostring

import numpy as np
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.planning.tag_poses import Table, TagPose, find_tag_poses, tables_of
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.simulator.layout import Layout
from lupin_tag_confirmation.confirmation import UnknownTagId, tag_number
from PIL import Image

from lupin_simulation.scene import MODULES, printed_marker

SDF_FILE = 'greenhouse.sdf'
HEADER = b"""<?xml version="1.0"?>
<!-- Made by generate_world of lupin_simulation. Do not edit: make it again. -->
"""
# The heights suit the camera of a small mobile robot, 0.3 m above the floor.
TABLE_HEIGHT_M = 0.20
TAG_HEIGHT_M = 0.30  # of the centre of each tag
WALL_HEIGHT_M = 0.2  # below the camera, so that no wall hides a tag
THICKNESS_M = 0.1  # of floor and walls
PLATE_THICKNESS_M = 0.004
GAP_M = 0.0005  # between the plate and the tag on it
MODULE_PIXELS = 16  # sharp at 0.2 m, and coarse enough for renderers without mipmaps
WHITE, GREY, BROWN, GREEN = '0.9 0.9 0.9', '0.6 0.6 0.6', '0.45 0.35 0.25', '0.35 0.45 0.35'
# From above and from each side, so that no tag is dark.
LIGHT_DIRECTIONS = {
    'above': '0 0 -1',
    'south': '0 1 -0.5',
    'north': '0 -1 -0.5',
    'west': '1 0 -0.5',
    'east': '-1 0 -0.5',
}


def tag_poses_by_number(layout: Layout, walls: Walls) -> dict[int, TagPose]:
    """
    Return the pose of each tag by its number, in numeric order.

    Raises StartUpError for an id outside tag36h11, or a table without an area.
    """
    try:
        tag_poses = find_tag_poses(layout, walls).items()
        return dict(sorted((tag_number(tag_id), each) for tag_id, each in tag_poses))
    except UnknownTagId as error:
        raise StartUpError(str(error)) from error


def roll_pitch_yaw(tag_pose: TagPose) -> tuple[float, float, float]:
    """Return the pose of a frame whose z points out of the tag's face, x to the viewer's right, and y up."""
    return math.pi / 2, 0.0, tag_pose.facing + math.pi / 2


def paper_m(side_m: float) -> float:
    """Return the width of a tag with its white border, one module on each side."""
    return side_m * (MODULES + 2) / MODULES


def world_files(layout: Layout, walls: Walls, side_m: float) -> dict[str, bytes]:
    """
    Return the content of each file of the world by its path. The same input gives the same files.

    `side_m` is the length of the black square of each tag. Raises StartUpError.
    """
    tag_poses = tag_poses_by_number(layout, walls)
    sdf = _element('sdf', _world(layout, walls, tag_poses, side_m), version='1.6')
    indent(sdf)
    files = {SDF_FILE: HEADER + tostring(sdf) + b'\n'}
    for number in tag_poses:
        for path, content in _mesh_files(number, side_m).items():
            files[f'models/tag_{number}/{path}'] = content
    return files


def _mesh_files(number: int, side_m: float) -> dict[str, bytes]:
    half = paper_m(side_m) / 2
    corners = [(-half, -half), (half, -half), (half, half), (-half, half)]
    obj = [f'mtllib tag_{number}.mtl', *(f'v {x!r} {y!r} 0' for x, y in corners)]
    obj += ['vt 0 0', 'vt 1 0', 'vt 1 1', 'vt 0 1', 'vn 0 0 1', 'usemtl tag', 'f 1/1/1 2/2/1 3/3/1 4/4/1']
    mtl = ['newmtl tag', 'Ka 1 1 1', 'Kd 1 1 1', 'Ks 0 0 0', 'd 1', 'illum 1', f'map_Kd tag_{number}.png']
    paper = np.pad(printed_marker(number), 1, constant_values=255)
    texture = Image.fromarray(np.kron(paper, np.ones((MODULE_PIXELS, MODULE_PIXELS), np.uint8)))
    png = io.BytesIO()
    texture.convert('RGB').save(png, 'PNG')
    return {
        f'tag_{number}.obj': '\n'.join([*obj, '']).encode(),
        f'tag_{number}.mtl': '\n'.join([*mtl, '']).encode(),
        f'tag_{number}.png': png.getvalue(),
    }


def _element(name: str, /, *content: Element | str, **attributes: str) -> Element:
    """Return an element with this text, or with these children."""
    element = Element(name, attributes)
    for each in content:
        if isinstance(each, str):
            element.text = each
        else:
            element.append(each)
    return element


def _numbers(*values: float) -> str:
    return ' '.join(map(repr, values))


def _world(layout: Layout, walls: Walls, tag_poses: dict[int, TagPose], side_m: float) -> Element:
    (x0, y0, x1, y1), thick = walls, THICKNESS_M
    boxes = {
        'wall_south': Table(x0 - thick, y0 - thick, x1 + thick, y0),
        'wall_north': Table(x0 - thick, y1, x1 + thick, y1 + thick),
        'wall_west': Table(x0 - thick, y0, x0, y1),
        'wall_east': Table(x1, y0, x1 + thick, y1),
    }
    scene = _element(
        'scene',
        _element('ambient', '0.7 0.7 0.7 1'),
        _element('background', '0.7 0.8 0.9 1'),
        _element('shadows', 'false'),
    )
    return _element(
        'world',
        scene,
        *(_light(*each) for each in LIGHT_DIRECTIONS.items()),
        _box_model('floor', walls, -THICKNESS_M, 0.0, GREEN),
        *(_box_model(name, each, 0.0, WALL_HEIGHT_M, GREY) for name, each in boxes.items()),
        *(
            _box_model(f'table_{number}', each, 0.0, TABLE_HEIGHT_M, BROWN)
            for number, each in enumerate(tables_of(layout), 1)
        ),
        *(_tag_model(number, each, side_m) for number, each in tag_poses.items()),
        name='greenhouse',
    )


def _light(name: str, direction: str) -> Element:
    return _element(
        'light',
        _element('pose', '0 0 10 0 0 0'),
        _element('cast_shadows', 'false'),
        _element('diffuse', '0.35 0.35 0.35 1'),
        _element('specular', '0 0 0 1'),
        _element('direction', direction),
        name=name,
        type='directional',
    )


def _box_model(name: str, footprint: Table, bottom_m: float, top_m: float, colour: str) -> Element:
    x0, y0, x1, y1 = footprint
    centre = (x0 + x1) / 2, (y0 + y1) / 2, (bottom_m + top_m) / 2
    size = x1 - x0, y1 - y0, top_m - bottom_m
    return _model(name, f'{_numbers(*centre)} 0 0 0', *_box('body', size, '0 0 0', colour))


def _tag_model(number: int, tag_pose: TagPose, side_m: float) -> Element:
    """Return the model of a tag: its origin is the centre of the tag, z points out of its face, y up."""
    pose = _numbers(tag_pose.x, tag_pose.y, TAG_HEIGHT_M, *roll_pitch_yaw(tag_pose))
    mesh = _element('mesh', _element('uri', f'models/tag_{number}/tag_{number}.obj'))
    size = paper_m(side_m), paper_m(side_m), PLATE_THICKNESS_M
    behind = f'0 0 {-GAP_M - PLATE_THICKNESS_M / 2!r}'
    visual = _element('visual', _element('geometry', mesh), name='tag')
    return _model(f'tag_{number}', pose, visual, *_box('plate', size, behind, WHITE))


def _model(name: str, pose: str, *parts: Element) -> Element:
    link = _element('link', *parts, name='link')
    return _element('model', _element('static', 'true'), _element('pose', pose), link, name=name)


def _box(name: str, size: tuple[float, ...], position: str, colour: str) -> tuple[Element, Element]:
    """Return the visual and the collision of a box."""

    def shape() -> tuple[Element, Element]:
        box = _element('box', _element('size', _numbers(*size)))
        return _element('pose', f'{position} 0 0 0'), _element('geometry', box)

    material = _element('material', *(_element(each, f'{colour} 1') for each in ('ambient', 'diffuse')))
    return (
        _element('visual', *shape(), material, name=name),
        _element('collision', *shape(), name=name),
    )
