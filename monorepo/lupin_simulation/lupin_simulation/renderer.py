"""Render the SDF world with Drake, without a display."""

import logging
from pathlib import Path

import cv2
import numpy as np
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    LightParameter,
    MakeRenderEngineVtk,
    RenderCameraCore,
    RenderEngineVtkParams,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraInfo

from lupin_simulation.view import Tag

# Drake ignores the lights of the SDF.
LIGHTS = ((1, 0, -0.15), (-1, 0, -0.15), (0, 1, -0.15), (0, -1, -0.15))
NEAREST_M, FARTHEST_M = 0.01, 50.0
SUPERSAMPLING = 2  # a camera's pixel averages the light of its area


class World:
    """The world of an SDF file."""

    def __init__(
        self,
        sdf: str | Path,
        width: int = 640,
        height: int = 480,
        focal_length_pixels: float = 600.0,
        nearest_m: float = NEAREST_M,
    ):
        """
        Read the world; raises RuntimeError if the file is not a world.

        From far away, a tag is drawn in front of its plate only if `nearest_m` is large.
        """
        logging.getLogger('drake').setLevel(logging.ERROR)  # it warns of the lights
        builder = DiagramBuilder()
        plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
        models = Parser(plant).AddModels(str(sdf))
        lights = [LightParameter(type='directional', frame='world', direction=each) for each in LIGHTS]
        scene_graph.AddRenderer('vtk', MakeRenderEngineVtk(RenderEngineVtkParams(lights=lights)))
        plant.Finalize()
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self._query = scene_graph.get_query_output_port().Eval(
            scene_graph.GetMyContextFromRoot(self._context)
        )
        self._frame = scene_graph.world_frame_id()
        width, height, focal = (SUPERSAMPLING * each for each in (width, height, focal_length_pixels))
        size = CameraInfo(width, height, focal, focal, width / 2, height / 2)
        core = RenderCameraCore('vtk', size, ClippingRange(nearest_m, FARTHEST_M), RigidTransform())
        self._camera = ColorRenderCamera(core)
        self.tags: dict[int, Tag] = {}
        self.tables: list[tuple[float, float, float, float]] = []  # x0, y0, x1, y1
        for model in models:
            name = plant.GetModelInstanceName(model)
            body = plant.get_body(plant.GetBodyIndices(model)[0])
            pose = plant.EvalBodyPoseInWorld(plant.GetMyContextFromRoot(self._context), body)
            if name.startswith('tag_'):
                axes = pose.rotation().matrix().T
                self.tags[int(name.removeprefix('tag_'))] = Tag(pose.translation(), *axes)
            elif name.startswith('table_'):
                (geometry,) = plant.GetCollisionGeometriesForBody(body)
                centre, size = pose.translation(), scene_graph.model_inspector().GetShape(geometry).size()
                self.tables.append((*(centre - size / 2)[:2], *(centre + size / 2)[:2]))

    def look(self, eye: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Return the picture from one point towards another, RGB, uint8 of the shape (height, width, 3)."""
        ahead = (at - eye) / np.linalg.norm(at - eye)
        right = np.cross(ahead, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        pose = RigidTransform(RotationMatrix(np.column_stack([right, np.cross(ahead, right), ahead])), eye)
        picture = self._query.RenderColorImage(self._camera, self._frame, pose).data
        smaller = 1 / SUPERSAMPLING
        return cv2.resize(picture[..., :3], None, fx=smaller, fy=smaller, interpolation=cv2.INTER_AREA)
