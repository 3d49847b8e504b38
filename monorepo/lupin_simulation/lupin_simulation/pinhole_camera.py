"""Draw the picture that a camera takes of tags at a cluttered wall, with perspective, blur and noise."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from lupin_greenhouse_bridge.planning.tag_poses import TagPose
from lupin_greenhouse_bridge.runtime.poses import PoseInPlane

from lupin_simulation.tag36h11 import MODULES, marker

TAG_SIDE_M = 0.04  # of the black square
MODULE_PIXELS = 30  # of a marker that is drawn in perspective
SUPERSAMPLING = 3  # smooths the edges of a tag, which has no grey pixels
NEAREST_M = 0.05  # a tag that is nearer is not drawn
BACK = np.full((MODULES, MODULES), 255, np.uint8)  # of every tag


@dataclass(frozen=True)
class PinholeCamera:
    """
    A camera without distortion. Each picture is uint8 of the shape (height, width).

    In the camera's frame, x points to the right, y down and z ahead, in metres. `blur_pixels` and
    `noise_levels` are standard deviations.
    """

    width: int = 640
    height: int = 480
    focal_length_pixels: float = 600.0

    def look_at(
        self,
        tag: np.ndarray | None,
        random: np.random.Generator,
        *,
        distance_m: float = 0.5,
        angle_degrees: float = 0.0,
        blur_pixels: float = 0.0,
        noise_levels: float = 3.0,
    ) -> np.ndarray:
        """
        Return a picture of a tag's marker on white paper, or of the wall alone if the tag is None.

        The tag is turned by `angle_degrees` about an axis of a random direction in its plane, and rolled and
        shifted a little.
        """
        picture = self._wall(random)
        if tag is not None:
            paper = _paper(tag, random)
            self._draw(paper, *_random_placement(distance_m, angle_degrees, random), picture)
        return self._expose(picture, random, blur_pixels, noise_levels)

    def look_around(
        self,
        tags: Mapping[int, TagPose],
        eye: PoseInPlane,
        random: np.random.Generator,
        *,
        blur_pixels: float = 0.0,
        noise_levels: float = 3.0,
    ) -> np.ndarray:
        """
        Return a picture of the tags in view, which are given by their numbers.

        The camera is at `eye`, as high as the tags, and looks along the yaw. A nearer tag hides a farther
        one, from behind too. Tables are lower.
        """
        picture = self._wall(random)
        x, y, yaw = eye
        for number, tag in sorted(tags.items(), key=lambda each: -math.dist(each[1][:2], (x, y))):
            dx, dy, turned = tag.x - x, tag.y - y, tag.facing - yaw
            ahead = math.cos(yaw) * dx + math.sin(yaw) * dy
            centre = np.array([math.sin(yaw) * dx - math.cos(yaw) * dy, 0.0, ahead])
            axes = np.array([[-math.cos(turned), 0.0], [0.0, 1.0], [-math.sin(turned), 0.0]])
            is_front = math.cos(tag.facing) * dx + math.sin(tag.facing) * dy < 0.0
            side = marker(number, MODULE_PIXELS) if is_front else BACK
            self._draw(_paper(side, random), axes, centre, picture)
        return self._expose(picture, random, blur_pixels, noise_levels)

    def _wall(self, random: np.random.Generator) -> np.ndarray:
        """Return a picture of the wall, floats from 0 to 255, larger by SUPERSAMPLING."""
        size = (SUPERSAMPLING * self.width, SUPERSAMPLING * self.height)
        wall = np.full(size[::-1], random.uniform(60, 180))
        for cells in (6, 24):
            coarse = random.uniform(-40.0, 40.0, (cells, cells))
            wall += cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC)
        return np.clip(wall, 0, 255)

    def _expose(
        self, picture: np.ndarray, random: np.random.Generator, blur_pixels: float, noise_levels: float
    ) -> np.ndarray:
        """Return a picture in the size of the camera, with blur and noise."""
        picture = cv2.resize(picture, (self.width, self.height), interpolation=cv2.INTER_AREA)
        if blur_pixels > 0.0:
            picture = cv2.GaussianBlur(picture, (0, 0), blur_pixels)
        noise = random.normal(0.0, noise_levels, picture.shape)
        return np.clip(picture + noise, 0, 255).astype(np.uint8)

    def _draw(self, paper: np.ndarray, axes: np.ndarray, centre: np.ndarray, picture: np.ndarray) -> None:
        """
        Draw the paper of a tag into a picture of _wall(), unless it is too near.

        The columns of `axes` are the directions across and down the paper, in the camera's frame.
        """
        pixels = len(paper)
        side_m = TAG_SIDE_M * (MODULES + 2) / MODULES
        metres_per_pixel = side_m / pixels
        focal = SUPERSAMPLING * self.focal_length_pixels
        middle_x, middle_y = SUPERSAMPLING * self.width / 2, SUPERSAMPLING * self.height / 2
        intrinsics = np.array([[focal, 0.0, middle_x], [0.0, focal, middle_y], [0.0, 0.0, 1.0]])
        to_plane = np.array(
            [[metres_per_pixel, 0.0, -side_m / 2], [0.0, metres_per_pixel, -side_m / 2], [0.0, 0.0, 1.0]]
        )
        homography = intrinsics @ np.column_stack([axes, centre]) @ to_plane
        corners = homography @ np.array([[0, pixels, pixels, 0], [0, 0, pixels, pixels], [1, 1, 1, 1]])
        if corners[2].min() < NEAREST_M:
            return
        height, width = picture.shape
        (x0, x1), (y0, y1) = (
            np.clip([np.floor(each.min()), np.ceil(each.max()) + 1], 0, size).astype(int)
            for each, size in zip(corners[:2] / corners[2], (width, height), strict=True)
        )
        if x0 == x1 or y0 == y1:
            return
        homography = np.array([[1, 0, -x0], [0, 1, -y0], [0, 0, 1]]) @ homography
        size = (int(x1 - x0), int(y1 - y0))
        warped = cv2.warpPerspective(paper, homography, size, flags=cv2.INTER_LINEAR)
        mask = cv2.warpPerspective(np.ones_like(paper), homography, size, flags=cv2.INTER_NEAREST)
        np.copyto(picture[y0:y1, x0:x1], warped, where=mask > 0)


def _paper(tag: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Return a tag with its white border, one module wide, in random grey levels of white and black."""
    brightness, darkness = random.uniform(180, 250), random.uniform(5, 50)
    paper = np.pad(tag, len(tag) // MODULES, constant_values=255).astype(float)
    return darkness + paper / 255.0 * (brightness - darkness)


def _random_placement(
    distance_m: float, angle_degrees: float, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return the directions across and down a tag as columns, and its centre, in the camera's frame."""
    direction = random.uniform(0.0, 2 * np.pi)
    turn, _ = cv2.Rodrigues(np.radians(angle_degrees) * np.array([np.cos(direction), np.sin(direction), 0.0]))
    roll, _ = cv2.Rodrigues(np.array([0.0, 0.0, random.uniform(-0.3, 0.3)]))
    centre = np.array([*random.uniform(-0.08, 0.08, 2) * distance_m, distance_m])
    return (turn @ roll)[:, :2], centre
