"""Renders what a camera sees of a tag: perspective, blur, noise. For tests and for the camera stand-in."""

from dataclasses import dataclass

import cv2
import numpy as np

MODULES = 8  # of a tag36h11 along a side, black border included
SUPERSAMPLING = 3  # against the stairs of a tag drawn pixel by pixel


def marker(
    tag_number: int, module_pixels: int = 1, family: int = cv2.aruco.DICT_APRILTAG_36h11
) -> np.ndarray:
    """Return a tag with its black border, MODULES modules wide, as uint8; without the white around it."""
    if hasattr(cv2.aruco, 'generateImageMarker'):
        dictionary = cv2.aruco.getPredefinedDictionary(family)
        draw = cv2.aruco.generateImageMarker
    else:  # before OpenCV 4.7
        dictionary = cv2.aruco.Dictionary_get(family)
        draw = cv2.aruco.drawMarker
    return draw(dictionary, tag_number, (dictionary.markerSize + 2) * module_pixels)


@dataclass(frozen=True)
class Camera:
    """A pinhole camera, and the tag before it."""

    width: int = 640
    height: int = 480
    focal_length_pixels: float = 600.0
    tag_side_m: float = 0.12  # black border included

    def side_pixels(self, distance_m: float) -> float:
        """Return how long the side of a tag seen from the front is."""
        return self.focal_length_pixels * self.tag_side_m / distance_m

    def look_at(
        self,
        tag: np.ndarray | None,
        random: np.random.Generator,
        *,
        distance_m: float = 0.6,
        angle_degrees: float = 0.0,
        blur_pixels: float = 0.0,
        noise_levels: float = 3.0,
    ) -> np.ndarray:
        """
        Return a picture of a tag on white paper before a cluttered wall, uint8 of the shape (height, width).

        The tag (None: only the wall) is turned by `angle_degrees` about an axis of a random direction in its
        plane, and rolled and shifted a little; `blur_pixels` and `noise_levels` are standard deviations.
        """
        picture = self._wall(random)
        if tag is not None:
            self._stick(tag, picture, random, distance_m, angle_degrees)
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

    def _stick(self, tag, picture, random, distance_m, angle_degrees) -> None:
        margin = tag.shape[0] // MODULES  # the white that the family asks for, one module wide
        paper = np.pad(tag, margin, constant_values=255).astype(float)
        brightness, darkness = random.uniform(180, 250), random.uniform(5, 50)
        paper = darkness + paper / 255.0 * (brightness - darkness)
        side = self.tag_side_m * paper.shape[0] / tag.shape[0]
        metres_per_pixel = side / paper.shape[0]

        direction = random.uniform(0.0, 2 * np.pi)
        axis = np.array([np.cos(direction), np.sin(direction), 0.0]) * np.radians(angle_degrees)
        turn, _ = cv2.Rodrigues(axis)
        roll, _ = cv2.Rodrigues(np.array([0.0, 0.0, random.uniform(-0.3, 0.3)]))
        turn = turn @ roll
        centre = np.array([*random.uniform(-0.08, 0.08, 2) * distance_m, distance_m])
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
        homography = intrinsics @ np.column_stack([turn[:, 0], turn[:, 1], centre]) @ to_plane
        size = picture.shape[::-1]
        warped = cv2.warpPerspective(paper, homography, size, flags=cv2.INTER_LINEAR)
        mask = cv2.warpPerspective(np.ones_like(paper), homography, size, flags=cv2.INTER_NEAREST)
        np.copyto(picture, warped, where=mask > 0)
