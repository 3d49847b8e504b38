"""Write the world: SDFormat 1.6, and for each tag an OBJ mesh with its texture. Does not import ROS."""

import io
from collections.abc import Iterable

import numpy as np
from lupin_greenhouse_bridge.planning.tag_poses import Table, TagPose, tables_of
from lupin_greenhouse_bridge.planning.walls import Walls
from lupin_greenhouse_bridge.simulator.layout import Layout
from PIL import Image

from lupin_simulation.scene import MODULES, printed_marker
from lupin_simulation.tag_poses_in_world import (
    TABLE_HEIGHT_M,
    TAG_HEIGHT_M,
    roll_pitch_yaw,
    tag_poses_by_number,
)

SDF_FILE = 'greenhouse.sdf'
WALL_HEIGHT_M = 0.2  # below the camera, so that no wall hides a tag
THICKNESS_M = 0.1  # of floor and walls
PLATE_THICKNESS_M = 0.004
GAP_M = 0.0005  # between the plate and the tag on it
MODULE_PIXELS = 16  # sharp at 0.2 m, and coarse enough for renderers without mipmaps
WHITE, GREY, BROWN, GREEN = '0.9 0.9 0.9', '0.6 0.6 0.6', '0.45 0.35 0.25', '0.35 0.45 0.35'


def world_files(layout: Layout, walls: Walls, side_m: float) -> dict[str, bytes]:
    """
    Return the content of each file of the world by its path. The same input gives the same files.

    `side_m` is the length of the black square of each tag. Raises StartUpError.
    """
    tables, tag_poses = tables_of(layout), tag_poses_by_number(layout, walls)
    files = {SDF_FILE: _sdf(tables, tag_poses, side_m, walls).encode()}
    for number in tag_poses:
        for path, content in _model_files(number, side_m).items():
            files[f'models/tag_{number}/{path}'] = content
    return files


def _model_files(number: int, side_m: float) -> dict[str, bytes]:
    half = paper_m(side_m) / 2
    corners = [(-half, -half), (half, -half), (half, half), (-half, half)]
    obj = [f'mtllib tag_{number}.mtl', *(f'v {x!r} {y!r} 0' for x, y in corners)]
    obj += ['vt 0 0', 'vt 1 0', 'vt 1 1', 'vt 0 1', 'vn 0 0 1', 'usemtl tag', 'f 1/1/1 2/2/1 3/3/1 4/4/1']
    mtl = ['newmtl tag', 'Ka 1 1 1', 'Kd 1 1 1', 'Ks 0 0 0', 'd 1', 'illum 1', f'map_Kd tag_{number}.png']
    paper = np.pad(printed_marker(number), 1, constant_values=255)
    picture = Image.fromarray(np.kron(paper, np.ones((MODULE_PIXELS, MODULE_PIXELS), np.uint8))).convert(
        'RGB'
    )
    png = io.BytesIO()
    picture.save(png, 'PNG')
    return {
        f'tag_{number}.obj': '\n'.join([*obj, '']).encode(),
        f'tag_{number}.mtl': '\n'.join([*mtl, '']).encode(),
        f'tag_{number}.png': png.getvalue(),
    }


def paper_m(side_m: float) -> float:
    """Return the width of a tag with its white border, one module on each side."""
    return side_m * (MODULES + 2) / MODULES


def _sdf(tables: list[Table], tag_poses: dict[int, TagPose], side_m: float, walls: Walls) -> str:
    models = [*_floor_and_walls(walls)]
    for number, table in enumerate(tables, 1):
        models.append(_box(f'table_{number}', table, 0.0, TABLE_HEIGHT_M, BROWN))
    models += [_tag(number, each, side_m) for number, each in tag_poses.items()]
    return '\n'.join(
        [
            '<?xml version="1.0"?>',
            '<!-- Made by generate_world of lupin_simulation. Do not edit: make it again. -->',
            '<sdf version="1.6">',
            '  <world name="greenhouse">',
            '    <scene>',
            '      <ambient>0.7 0.7 0.7 1</ambient>',
            '      <background>0.7 0.8 0.9 1</background>',
            '      <shadows>false</shadows>',
            '    </scene>',
            *_lights(),
            *models,
            '  </world>',
            '</sdf>',
            '',
        ]
    )


def _lights() -> Iterable[str]:
    """Yield lights from above and from each side, so that no tag is dark."""
    directions = {'above': '0 0 -1', 'south': '0 1 -0.5', 'north': '0 -1 -0.5', 'west': '1 0 -0.5'}
    for name, direction in (directions | {'east': '-1 0 -0.5'}).items():
        yield (
            f'    <light name="{name}" type="directional">\n'
            '      <pose>0 0 10 0 0 0</pose>\n'
            '      <cast_shadows>false</cast_shadows>\n'
            '      <diffuse>0.35 0.35 0.35 1</diffuse>\n'
            '      <specular>0 0 0 1</specular>\n'
            f'      <direction>{direction}</direction>\n'
            '    </light>'
        )


def _floor_and_walls(walls: Walls) -> Iterable[str]:
    (x0, y0, x1, y1), thick = walls, THICKNESS_M
    yield _box('floor', walls, -THICKNESS_M, 0.0, GREEN)
    for name, wall in {
        'wall_south': Table(x0 - thick, y0 - thick, x1 + thick, y0),
        'wall_north': Table(x0 - thick, y1, x1 + thick, y1 + thick),
        'wall_west': Table(x0 - thick, y0, x0, y1),
        'wall_east': Table(x1, y0, x1 + thick, y1),
    }.items():
        yield _box(name, wall, 0.0, WALL_HEIGHT_M, GREY)


def _box(name: str, footprint: Table | Walls, bottom_m: float, top_m: float, colour: str) -> str:
    x, y = (footprint.x0 + footprint.x1) / 2, (footprint.y0 + footprint.y1) / 2
    size = f'{footprint.x1 - footprint.x0!r} {footprint.y1 - footprint.y0!r} {top_m - bottom_m!r}'
    return _model(
        name, f'{x!r} {y!r} {(bottom_m + top_m) / 2!r} 0 0 0', _solid('body', size, '0 0 0', colour)
    )


def _tag(number: int, tag_pose: TagPose, side_m: float) -> str:
    """Return the model of a tag: its origin is the centre of the tag, z points out of its face, y up."""
    angles = ' '.join(map(repr, roll_pitch_yaw(tag_pose)))
    behind = -GAP_M - PLATE_THICKNESS_M / 2
    width = paper_m(side_m)
    mesh = (
        '        <visual name="tag">\n'
        f'          <geometry><mesh><uri>models/tag_{number}/tag_{number}.obj</uri></mesh></geometry>\n'
        '        </visual>\n'
    )
    plate = _solid('plate', f'{width!r} {width!r} {PLATE_THICKNESS_M!r}', f'0 0 {behind!r}', WHITE)
    pose = f'{tag_pose.x!r} {tag_pose.y!r} {TAG_HEIGHT_M!r} {angles}'
    return _model(f'tag_{number}', pose, mesh + plate)


def _model(name: str, pose: str, content: str) -> str:
    return (
        f'    <model name="{name}">\n'
        '      <static>true</static>\n'
        f'      <pose>{pose}</pose>\n'
        '      <link name="link">\n'
        f'{content}'
        '      </link>\n'
        '    </model>'
    )


def _solid(name: str, size: str, place_m: str, colour: str) -> str:
    shape = f'<pose>{place_m} 0 0 0</pose>\n          <geometry><box><size>{size}</size></box></geometry>\n'
    return (
        f'        <visual name="{name}">\n          {shape}'
        f'          <material><ambient>{colour} 1</ambient><diffuse>{colour} 1</diffuse></material>\n'
        '        </visual>\n'
        f'        <collision name="{name}">\n          {shape}        </collision>\n'
    )
