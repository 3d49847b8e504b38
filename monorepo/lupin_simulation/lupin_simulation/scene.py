"""Render a camera's picture of a tag, with perspective, blur and noise, for tests and simulations."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from lupin_greenhouse_bridge.planning.tag_poses import TagPose
from lupin_tag_confirmation.confirmation import TAG_COUNT

MODULES = 8  # of a tag36h11 along a side, black border included
SUPERSAMPLING = 3  # smooths the edges of a tag drawn pixel by pixel
MODULE_PIXELS = 30
NEAREST_M = 0.05
BACK = np.full((MODULES, MODULES), 255, np.uint8)  # of every tag


def marker(
    tag_number: int, module_pixels: int = 1, family: int = cv2.aruco.DICT_APRILTAG_36h11
) -> np.ndarray:
    """Return a tag of MODULES modules as uint8, with its black border and without the white margin."""
    if hasattr(cv2.aruco, 'generateImageMarker'):
        dictionary = cv2.aruco.getPredefinedDictionary(family)
        draw = cv2.aruco.generateImageMarker
    else:  # before OpenCV 4.7
        dictionary = cv2.aruco.Dictionary_get(family)
        draw = cv2.aruco.drawMarker
    return draw(dictionary, tag_number, (dictionary.markerSize + 2) * module_pixels)


def printed_marker(tag_number: int) -> np.ndarray:
    """Return a tag36h11 as the AprilTag project prints it, one pixel per module."""
    return np.rot90(marker(tag_number), 2)


DECOYS = ('other ids', 'other families', 'texture', 'clutter')
OTHER_FAMILIES = (
    cv2.aruco.DICT_APRILTAG_16h5,
    cv2.aruco.DICT_APRILTAG_25h9,
    cv2.aruco.DICT_APRILTAG_36h10,
    cv2.aruco.DICT_6X6_1000,
)


@dataclass(frozen=True)
class Camera:
    """A pinhole camera and the size of the tag."""

    width: int = 640
    height: int = 480
    focal_length_pixels: float = 600.0
    tag_side_m: float = 0.04  # black border included

    def side_pixels(self, distance_m: float) -> float:
        """Return the length of a side of a tag seen from the front."""
        return self.focal_length_pixels * self.tag_side_m / distance_m

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
        Return a picture of a tag on white paper at a cluttered wall, uint8 of the shape (height, width).

        The tag (None: only the wall) is turned by `angle_degrees` about an axis of a random direction in its
        plane, and rolled and shifted a little; `blur_pixels` and `noise_levels` are standard deviations.
        """
        picture = self._wall(random)
        if tag is not None:
            self._stick(tag, picture, _shades(random), *_placement(random, distance_m, angle_degrees))
        return self._expose(picture, random, blur_pixels, noise_levels)

    def look_around(
        self,
        tags: Mapping[int, TagPose],
        eye: tuple[float, float, float],
        random: np.random.Generator,
        *,
        blur_pixels: float = 0.0,
        noise_levels: float = 3.0,
    ) -> np.ndarray:
        """
        Return a picture of the tags in view, by their numbers, uint8 of the shape (height, width).

        `eye` is x and y of the camera in metres, and the direction that it looks along, in radians to the x
        axis. It is as high as the tags. A nearer tag hides a farther one, from behind too; tables are lower.
        """
        picture = self._wall(random)
        x, y, yaw = eye
        for number, tag in sorted(tags.items(), key=lambda each: -math.dist(each[1][:2], (x, y))):
            dx, dy, turned = tag.x - x, tag.y - y, tag.facing - yaw
            ahead = math.cos(yaw) * dx + math.sin(yaw) * dy
            centre = np.array([math.sin(yaw) * dx - math.cos(yaw) * dy, 0.0, ahead])
            across, down = np.array([-math.cos(turned), 0.0, -math.sin(turned)]), np.array([0.0, 1.0, 0.0])
            is_front = math.cos(tag.facing) * dx + math.sin(tag.facing) * dy < 0.0
            side = marker(number, MODULE_PIXELS) if is_front else BACK
            self._stick(side, picture, _shades(random), across, down, centre)
        return self._expose(picture, random, blur_pixels, noise_levels)

    def _expose(self, picture, random, blur_pixels, noise_levels) -> np.ndarray:
        picture = cv2.resize(picture, (self.width, self.height), interpolation=cv2.INTER_AREA)
        if blur_pixels > 0.0:
            picture = cv2.GaussianBlur(picture, (0, 0), blur_pixels)
        noise = random.normal(0.0, noise_levels, picture.shape)
        return np.clip(picture + noise, 0, 255).astype(np.uint8)

    def _wall(self, random) -> np.ndarray:
        size = (SUPERSAMPLING * self.width, SUPERSAMPLING * self.height)
        wall = np.full(size[::-1], float(random.uniform(60, 180)))
        for cells in (6, 24):
            coarse = random.uniform(-40.0, 40.0, (cells, cells))
            wall += cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC)
        return np.clip(wall, 0, 255)

    def _stick(self, tag, picture, shades, across, down, centre) -> None:
        """Draw a tag, unless it is too near. In the camera's frame x is to the right, y down and z ahead."""
        margin = tag.shape[0] // MODULES  # the white margin of the family, one module wide
        brightness, darkness = shades
        paper = np.pad(tag, margin, constant_values=255).astype(float)
        paper = darkness + paper / 255.0 * (brightness - darkness)
        pixels = paper.shape[0]
        side = self.tag_side_m * pixels / tag.shape[0]
        metres_per_pixel = side / pixels
        focal = SUPERSAMPLING * self.focal_length_pixels
        intrinsics = np.array(
            [
                [focal, 0.0, SUPERSAMPLING * self.width / 2],
                [0.0, focal, SUPERSAMPLING * self.height / 2],
                [0.0, 0.0, 1.0],
            ]
        )
        to_plane = np.array(
            [[metres_per_pixel, 0.0, -side / 2], [0.0, metres_per_pixel, -side / 2], [0.0, 0.0, 1.0]]
        )
        homography = intrinsics @ np.column_stack([across, down, centre]) @ to_plane
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


def _shades(random) -> tuple[float, float]:
    """Return the grey levels of white and black paper."""
    return random.uniform(180, 250), random.uniform(5, 50)


def _placement(random, distance_m, angle_degrees) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the directions across and down a tag, and its centre in metres, in the camera's frame."""
    direction = random.uniform(0.0, 2 * np.pi)
    axis = np.array([np.cos(direction), np.sin(direction), 0.0]) * np.radians(angle_degrees)
    turn, _ = cv2.Rodrigues(axis)
    roll, _ = cv2.Rodrigues(np.array([0.0, 0.0, random.uniform(-0.3, 0.3)]))
    turn = turn @ roll
    return turn[:, 0], turn[:, 1], np.array([*random.uniform(-0.08, 0.08, 2) * distance_m, distance_m])


SMALL_CAMERA = Camera(width=320, height=240, focal_length_pixels=300.0)


def decoy(number: int, tag_number: int, random: np.random.Generator) -> np.ndarray:
    """Return a small picture without that tag; the kinds of DECOYS alternate."""
    kind = DECOYS[number % len(DECOYS)]
    conditions = {
        'distance_m': random.uniform(0.1, 0.6),
        'angle_degrees': random.uniform(0.0, 50.0),
        'blur_pixels': random.uniform(0.0, 1.0),
    }
    if kind == 'other ids':
        other = int(random.choice([each for each in range(TAG_COUNT) if each != tag_number]))
        return SMALL_CAMERA.look_at(marker(other, 20), random, **conditions)
    if kind == 'other families':
        family = OTHER_FAMILIES[number // len(DECOYS) % len(OTHER_FAMILIES)]
        return SMALL_CAMERA.look_at(marker(int(random.integers(30)), 20, family), random, **conditions)
    if kind == 'texture':
        cells = int(random.integers(20, 120))
        texture = random.integers(0, 2, (cells, cells), dtype=np.uint8) * 255
        return cv2.resize(texture, (320, 240), interpolation=cv2.INTER_NEAREST)
    picture = SMALL_CAMERA.look_at(None, random, blur_pixels=conditions['blur_pixels'])
    for _ in range(40):
        quad = random.uniform(0, 320, 2) + random.uniform(-40, 40, (4, 2))
        cv2.fillConvexPoly(picture, cv2.convexHull(quad.astype(np.int32)), int(random.integers(256)))
    return picture
