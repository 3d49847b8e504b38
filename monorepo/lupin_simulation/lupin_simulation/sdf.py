"""Write the world: SDFormat 1.6, and for each tag an OBJ mesh with its texture. Does not import ROS."""

import io
import math
from xml.etree.ElementTree import fromstring, indent, tostring

import numpy as np
from lupin_greenhouse_bridge.simulator.layout import Layout
from lupin_planning.tag_poses import TagPose, find_tag_poses, tables_of
from lupin_planning.walls import Walls
from lupin_tag_confirmation.confirmation import tag_number
from PIL import Image

from lupin_simulation.tag36h11 import MODULES, printed_marker

Rectangle = tuple[float, float, float, float]  # x0, y0, x1 and y1 in metres

SDF_FILE = 'greenhouse.sdf'
# The heights suit the camera of a small mobile robot, 0.3 m above the floor.
TAG_HEIGHT_M = 0.30  # of the centre of each tag
TABLE_HEIGHT_M = 0.20
WALL_HEIGHT_M = 0.20
THICKNESS_M = 0.1  # of the floor and the walls
PLATE_THICKNESS_M = 0.004
POST_M = 0.01  # side length of the post below a plate
GAP_M = 0.0005  # between the plate and the tag on it
TEXTURE_MODULE_PIXELS = 16  # sharp at 0.2 m, and coarse enough for renderers without mipmaps
SLATE, GREY, BROWN, GREEN = '0.35 0.4 0.45', '0.65 0.65 0.65', '0.7 0.55 0.38', '0.5 0.62 0.48'
# From above and from each side, so that no tag is dark.
LIGHT_DIRECTIONS = ('0 0 -1', '0 1 -0.5', '0 -1 -0.5', '1 0 -0.5', '-1 0 -0.5')

HEADER = b"""<?xml version="1.0"?>
<!-- Made by generate_world of lupin_simulation. Do not edit: make it again. -->
"""
WORLD = """
<sdf version="1.6"><world name="greenhouse">
  <scene>
    <ambient>0.7 0.7 0.7 1</ambient><background>0.7 0.8 0.9 1</background><shadows>false</shadows>
  </scene>
  {lights}
  {models}
</world></sdf>"""
LIGHT = """
<light name="light_{number}" type="directional">
  <pose>0 0 10 0 0 0</pose><cast_shadows>false</cast_shadows>
  <diffuse>0.35 0.35 0.35 1</diffuse><specular>0 0 0 1</specular><direction>{direction}</direction>
</light>"""
MODEL = """
<model name="{name}"><static>true</static><pose>{pose}</pose><link name="link">
  {visuals}
  <collision name="{part}">{box}</collision>
</link></model>"""
VISUAL = """
<visual name="{part}">
  {box}<material><ambient>{colour} 1</ambient><diffuse>{colour} 1</diffuse></material>
</visual>"""
BOX = '<pose>0 {y} {z} 0 0 0</pose><geometry><box><size>{size}</size></box></geometry>'
TAG_VISUAL = '<visual name="tag"><geometry><mesh><uri>{mesh}</uri></mesh></geometry></visual>'

MESH = """mtllib tag_{number}.mtl
v -{half} -{half} 0
v {half} -{half} 0
v {half} {half} 0
v -{half} {half} 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vn 0 0 1
usemtl tag
f 1/1/1 2/2/1 3/3/1 4/4/1
"""
MATERIAL = """newmtl tag
Ka 1 1 1
Kd 1 1 1
Ks 0 0 0
d 1
illum 1
map_Kd tag_{number}.png
"""


def world_files(layout: Layout, walls: Walls, side_m: float) -> dict[str, bytes]:
    """
    Return the content of each file of the world by its path. The same input gives the same files.

    `side_m` is the length of the black square of each tag. Raises UnknownTagId for an id outside tag36h11,
    and StartUpError for a table without an area.
    """
    numbered = ((tag_number(tag_id), pose) for tag_id, pose in find_tag_poses(layout, walls).items())
    tag_poses = dict(sorted(numbered))
    paper_m = side_m * (MODULES + 2) / MODULES  # with a white border, one module wide
    files = {SDF_FILE: _sdf(layout, walls, tag_poses, paper_m)}
    for number in tag_poses:
        path = f'models/tag_{number}/tag_{number}'
        files[f'{path}.obj'] = MESH.format(number=number, half=paper_m / 2).encode()
        files[f'{path}.mtl'] = MATERIAL.format(number=number).encode()
        files[f'{path}.png'] = _texture(number)
    return files


def _texture(number: int) -> bytes:
    """Return the PNG file of a tag with its white border."""
    paper = np.pad(printed_marker(number), 1, constant_values=255)
    pixels = np.kron(paper, np.ones((TEXTURE_MODULE_PIXELS, TEXTURE_MODULE_PIXELS), np.uint8))
    png = io.BytesIO()
    Image.fromarray(pixels).convert('RGB').save(png, 'PNG')
    return png.getvalue()


def _sdf(layout: Layout, walls: Walls, tag_poses: dict[int, TagPose], paper_m: float) -> bytes:
    x0, y0, x1, y1 = walls
    west, south, east, north = x0 - THICKNESS_M, y0 - THICKNESS_M, x1 + THICKNESS_M, y1 + THICKNESS_M
    models = [
        _box('floor', walls, -THICKNESS_M, 0.0, GREEN),
        _box('wall_south', (west, south, east, y0), 0.0, WALL_HEIGHT_M, GREY),
        _box('wall_north', (west, y1, east, north), 0.0, WALL_HEIGHT_M, GREY),
        _box('wall_west', (west, y0, x0, y1), 0.0, WALL_HEIGHT_M, GREY),
        _box('wall_east', (x1, y0, east, y1), 0.0, WALL_HEIGHT_M, GREY),
    ]
    for number, table in enumerate(tables_of(layout), 1):
        models.append(_box(f'table_{number}', table, 0.0, TABLE_HEIGHT_M, BROWN))
    models += [_tag(number, tag_pose, paper_m) for number, tag_pose in tag_poses.items()]
    lights = [
        LIGHT.format(number=number, direction=direction)
        for number, direction in enumerate(LIGHT_DIRECTIONS, 1)
    ]
    sdf = fromstring(WORLD.format(lights=''.join(lights), models=''.join(models)))  # noqa: S314 - our own text
    indent(sdf)
    return HEADER + tostring(sdf) + b'\n'


def _box(name: str, footprint: Rectangle, bottom_m: float, top_m: float, colour: str) -> str:
    """Return the model of a box."""
    x0, y0, x1, y1 = footprint
    pose = f'{(x0 + x1) / 2} {(y0 + y1) / 2} {(bottom_m + top_m) / 2} 0 0 0'
    box = BOX.format(y=0, z=0, size=f'{x1 - x0} {y1 - y0} {top_m - bottom_m}')
    visual = VISUAL.format(part='body', box=box, colour=colour)
    return MODEL.format(name=name, pose=pose, visuals=visual, part='body', box=box)


def _tag(number: int, tag_pose: TagPose, paper_m: float) -> str:
    """
    Return the model of a tag on its plate, which a post carries.

    In its frame, z is out of the face, x to the viewer's right.
    """
    x, y, facing = tag_pose
    pose = f'{x} {y} {TAG_HEIGHT_M} {math.pi / 2} 0.0 {facing + math.pi / 2}'
    tag = TAG_VISUAL.format(mesh=f'models/tag_{number}/tag_{number}.obj')
    plate = BOX.format(y=0, z=-GAP_M - PLATE_THICKNESS_M / 2, size=f'{paper_m} {paper_m} {PLATE_THICKNESS_M}')
    post_z = -GAP_M - PLATE_THICKNESS_M - POST_M / 2
    post = BOX.format(y=-TAG_HEIGHT_M / 2, z=post_z, size=f'{POST_M} {TAG_HEIGHT_M} {POST_M}')
    boxes = {'plate': plate, 'post': post}
    visuals = [VISUAL.format(part=part, box=box, colour=SLATE) for part, box in boxes.items()]
    name = f'tag_{number}'
    return MODEL.format(name=name, pose=pose, visuals=tag + ''.join(visuals), part='plate', box=plate)
