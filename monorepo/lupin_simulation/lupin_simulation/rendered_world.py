"""Render the SDF world with Drake, without a display. Imports Drake only when a world is opened."""

import logging
import math
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from lupin_greenhouse_bridge.errors import StartUpError

from lupin_simulation.sdf import TAG_HEIGHT_M
from lupin_simulation.settings import SOURCE_OF_DRAKE

# Drake ignores the lights of the SDF.
LIGHT_DIRECTIONS = ((1, 0, -0.3), (-1, 0, -0.3), (0, 1, -0.3), (0, -1, -0.3))
NEAREST_M, FARTHEST_M = 0.01, 50.0
SUPERSAMPLING = 2  # a camera's pixel averages the light of its area


class TagModel(NamedTuple):
    """The centre of a tag in the world, in metres, and the axes of its model's frame."""

    centre: np.ndarray
    to_right: np.ndarray  # of a viewer in front of the tag
    up: np.ndarray
    out: np.ndarray  # of the tag's face


class View(NamedTuple):
    """Where a camera is, and a point that it looks at, both as x, y and z in metres."""

    eye: np.ndarray
    at: np.ndarray


def viewpoint(tag: TagModel, distance_m: float, angle_degrees: float) -> np.ndarray:
    """Return a point at the height and at this distance of a tag, turned from its normal to its right."""
    angle = math.radians(angle_degrees)
    return tag.centre + distance_m * (math.cos(angle) * tag.out + math.sin(angle) * tag.to_right)


def view_ahead(x: float, y: float, yaw: float) -> View:
    """Return the view of the camera of a robot with this pose. The camera is as high as the tags."""
    eye = np.array([x, y, TAG_HEIGHT_M])
    return View(eye, eye + np.array([math.cos(yaw), math.sin(yaw), 0.0]))


def camera_axes(eye: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return what is right, down and ahead in a picture from one point towards another, as columns."""
    ahead = (at - eye) / np.linalg.norm(at - eye)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(ahead, right), ahead])


class RenderedWorld:
    """The world of an SDF file: its tags by number, its tables as (x0, y0, x1, y1), and pictures of it."""

    def __init__(
        self,
        sdf_file: str | Path,
        width: int = 640,
        height: int = 480,
        focal_length_pixels: float = 600.0,
        nearest_m: float = NEAREST_M,
    ) -> None:
        """
        Read the world; raises StartUpError if Drake is missing, or if the file is not a world.

        For pictures from far away, set a large `nearest_m`: otherwise the plate of a tag can hide the tag.
        """
        if not Path(sdf_file).is_file():
            raise StartUpError(f"there is no file '{sdf_file}': name a world made by generate_world")
        try:
            from pydrake import geometry
            from pydrake.math import RigidTransform
            from pydrake.multibody.parsing import Parser
            from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
            from pydrake.systems.framework import DiagramBuilder
            from pydrake.systems.sensors import CameraInfo
        except ImportError as error:
            raise StartUpError(f'Drake is missing ({error}): {SOURCE_OF_DRAKE}') from error

        logging.getLogger('drake').setLevel(logging.ERROR)  # it warns of the lights
        builder = DiagramBuilder()
        plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
        try:
            models = Parser(plant).AddModels(str(sdf_file))
        except RuntimeError as error:
            problem = f"'{sdf_file}' is not an SDF world: use a world made by generate_world"
            raise StartUpError(f'{problem}: {error}') from error
        lights = [
            geometry.LightParameter(type='directional', frame='world', direction=each)
            for each in LIGHT_DIRECTIONS
        ]
        engine = geometry.MakeRenderEngineVtk(geometry.RenderEngineVtkParams(lights=lights))
        scene_graph.AddRenderer('vtk', engine)
        plant.Finalize()
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        scene_context = scene_graph.GetMyContextFromRoot(self._context)
        self._query = scene_graph.get_query_output_port().Eval(scene_context)
        self._frame = scene_graph.world_frame_id()
        self._size = (width, height)
        width, height = SUPERSAMPLING * width, SUPERSAMPLING * height
        focal = SUPERSAMPLING * focal_length_pixels
        info = CameraInfo(width, height, focal, focal, width / 2, height / 2)
        clipping = geometry.ClippingRange(nearest_m, FARTHEST_M)
        core = geometry.RenderCameraCore('vtk', info, clipping, RigidTransform())
        self._camera = geometry.ColorRenderCamera(core)
        self.tags: dict[int, TagModel] = {}
        self.tables: list[tuple[float, float, float, float]] = []
        for model in models:
            name = plant.GetModelInstanceName(model)
            body = plant.get_body(plant.GetBodyIndices(model)[0])
            pose = plant.EvalBodyPoseInWorld(plant.GetMyContextFromRoot(self._context), body)
            if name.startswith('tag_'):
                axes = pose.rotation().matrix().T
                self.tags[int(name.removeprefix('tag_'))] = TagModel(pose.translation(), *axes)
            elif name.startswith('table_'):
                (shape,) = plant.GetCollisionGeometriesForBody(body)
                centre, size = pose.translation(), scene_graph.model_inspector().GetShape(shape).size()
                self.tables.append((*(centre - size / 2)[:2], *(centre + size / 2)[:2]))

    def look(self, eye: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Return the picture from one point towards another, RGB, uint8 of the shape (height, width, 3)."""
        from pydrake.math import RigidTransform, RotationMatrix

        pose = RigidTransform(RotationMatrix(camera_axes(eye, at)), eye)
        picture: np.ndarray = self._query.RenderColorImage(self._camera, self._frame, pose).data
        return cv2.resize(picture[..., :3], self._size, interpolation=cv2.INTER_AREA)
