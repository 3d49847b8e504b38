"""Draw the picture that a camera takes of tags at a cluttered wall, with perspective, blur and noise."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from lupin_planning.poses import PoseInPlane
from lupin_planning.tag_poses import TagPose

from lupin_simulation.tag36h11 import MODULES, marker

TAG_SIDE_M = 0.04  # of the black square
MODULE_PIXELS = 30  # of a marker that is drawn in perspective
SUPERSAMPLING = 3  # smooths the edges of a tag, which has no grey pixels
NEAREST_M = 0.05  # a tag that is nearer is not drawn
BACK = np.full((MODULES, MODULES), 255, np.uint8)  # of every tag
PAPER_CORNERS = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])  # right and down


@dataclass(frozen=True)
class PinholeCamera:
    """
    A camera without distortion: draw a scene, then expose it to get a picture.

    A scene is an array of floats, 0 to 255, larger than the picture by SUPERSAMPLING. In the camera's frame,
    x points to the right, y down and z ahead, in metres.
    """

    width: int = 640
    height: int = 480
    focal_length_pixels: float = 600.0

    def wall(self, random: np.random.Generator) -> np.ndarray:
        """Return a scene without a tag."""
        size = (SUPERSAMPLING * self.width, SUPERSAMPLING * self.height)
        scene = np.full(size[::-1], random.uniform(60, 180))
        for cells in (6, 24):
            coarse = random.uniform(-40.0, 40.0, (cells, cells))
            scene += cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC)
        return scene.clip(0, 255)

    def scene_of_tag(
        self, tag_number: int, random: np.random.Generator, distance_m: float, angle_degrees: float = 0.0
    ) -> np.ndarray:
        """Return a scene with one tag: turned about an axis in its plane, and rolled and shifted a little."""
        scene, paper = self.wall(random), _paper(marker(tag_number, MODULE_PIXELS), random)
        direction = random.uniform(0.0, 2 * np.pi)
        axis = np.radians(angle_degrees) * np.array([np.cos(direction), np.sin(direction), 0.0])
        turn, _ = cv2.Rodrigues(axis)
        roll, _ = cv2.Rodrigues(np.array([0.0, 0.0, random.uniform(-0.3, 0.3)]))
        centre = np.array([*random.uniform(-0.08, 0.08, 2) * distance_m, distance_m])
        self._draw(paper, (turn @ roll)[:, :2], centre, scene)
        return scene

    def scene_from(
        self, eye: PoseInPlane, tags: Mapping[int, TagPose], random: np.random.Generator
    ) -> np.ndarray:
        """
        Return a scene with those of `tags`, by number, that are in view from `eye`.

        The camera is as high as the tags, and looks along the yaw. A nearer tag hides a farther one, also if
        it shows its back. Tables are lower and hide nothing.
        """
        scene = self.wall(random)
        x, y, yaw = eye
        for number, tag in sorted(tags.items(), key=lambda item: -math.dist(item[1][:2], (x, y))):
            dx, dy, turned = tag.x - x, tag.y - y, tag.facing - yaw
            ahead = math.cos(yaw) * dx + math.sin(yaw) * dy
            centre = np.array([math.sin(yaw) * dx - math.cos(yaw) * dy, 0.0, ahead])
            axes = np.array([[-math.cos(turned), 0.0], [0.0, 1.0], [-math.sin(turned), 0.0]])
            is_front = math.cos(tag.facing) * dx + math.sin(tag.facing) * dy < 0.0
            side = marker(number, MODULE_PIXELS) if is_front else BACK
            self._draw(_paper(side, random), axes, centre, scene)
        return scene

    def expose(
        self,
        scene: np.ndarray,
        random: np.random.Generator,
        blur_pixels: float = 0.0,
        noise_levels: float = 3.0,
    ) -> np.ndarray:
        """
        Return the picture of a scene, uint8 of the shape (height, width).

        `blur_pixels` and `noise_levels` are the standard deviations of the blur and the noise.
        """
        picture = cv2.resize(scene, (self.width, self.height), interpolation=cv2.INTER_AREA)
        if blur_pixels > 0.0:
            picture = cv2.GaussianBlur(picture, (0, 0), blur_pixels)
        noise = random.normal(0.0, noise_levels, (self.height, self.width))
        return (noise + picture).clip(0, 255).astype(np.uint8)

    def _draw(self, paper: np.ndarray, axes: np.ndarray, centre: np.ndarray, scene: np.ndarray) -> None:
        """
        Draw the paper of a tag into a scene, unless it is too near.

        The columns of `axes` are the directions across and down the paper, in the camera's frame.
        """
        side_m = TAG_SIDE_M * (MODULES + 2) / MODULES
        corners = centre + side_m * PAPER_CORNERS @ axes.T
        if corners[:, 2].min() < NEAREST_M:
            return
        size = np.array(scene.shape[::-1])
        points = SUPERSAMPLING * self.focal_length_pixels * corners[:, :2] / corners[:, 2:] + size / 2
        # Only the part of the scene around the tag is computed.
        x0, y0 = np.clip(np.floor(points.min(axis=0)), 0, size).astype(int)
        x1, y1 = np.clip(np.ceil(points.max(axis=0)) + 1, 0, size).astype(int)
        if x0 == x1 or y0 == y1:
            return
        on_paper = len(paper) * (PAPER_CORNERS + 0.5)
        homography = cv2.getPerspectiveTransform(*np.array([on_paper, points - (x0, y0)], np.float32))
        part = (int(x1 - x0), int(y1 - y0))
        warped = cv2.warpPerspective(paper, homography, part, flags=cv2.INTER_LINEAR)
        mask = cv2.warpPerspective(np.ones_like(paper), homography, part, flags=cv2.INTER_NEAREST)
        np.copyto(scene[y0:y1, x0:x1], warped, where=mask > 0)


def _paper(tag: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Return a tag with its white border, one module wide, in random grey levels of white and black."""
    brightness, darkness = random.uniform(180, 250), random.uniform(5, 50)
    paper = np.pad(tag, len(tag) // MODULES, constant_values=255).astype(float)
    return darkness + paper / 255.0 * (brightness - darkness)
