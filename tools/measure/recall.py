"""
How often the camera node's detector finds a tag: by distance, angle, blur and noise, as a table.

Each figure is the share of 30 rendered pictures, one for each of the ids 1 to 30, in which the tag was found,
large and sharp enough for the node's defaults. Distances are for the camera and the tag of scene.py.
"""

import numpy as np
from lupin_perception import scene
from lupin_perception.confirmation import Criteria
from lupin_perception.detector import TagDetector, cv2

IDS = range(1, 31)
DISTANCES_M = (0.4, 0.8, 1.5, 2.5)
ANGLES_DEGREES = (0, 30, 45, 60)
CONDITIONS = {
    'sharp': {},
    'blur 1 px': {'blur_pixels': 1.0},
    'blur 2 px': {'blur_pixels': 2.0},
    'noise 15': {'noise_levels': 15.0},
    'blur 1 px, noise 15': {'blur_pixels': 1.0, 'noise_levels': 15.0},
}


def recall(camera: scene.Camera, detector: TagDetector, criteria: Criteria, **conditions) -> float:
    """Return the share of the ids that are found and fit for confirmation."""
    found = 0
    for tag_number in IDS:
        random = np.random.default_rng(tag_number)
        picture = camera.look_at(scene.marker(tag_number, module_pixels=30), random, **conditions)
        found += any(
            each.tag_number == tag_number
            and each.side_pixels >= criteria.min_side_pixels
            and each.sharpness >= criteria.min_sharpness
            for each in detector.detect(picture)
        )
    return found / len(IDS)


def main() -> None:
    """Print the table."""
    camera, detector, criteria = scene.Camera(), TagDetector(), Criteria()
    print(f'OpenCV {cv2.__version__}; {camera.width} x {camera.height} pixels')
    print(f'| distance | side of the tag | angle | {" | ".join(CONDITIONS)} |')
    print('|---|---|---|' + '---|' * len(CONDITIONS))
    for distance_m in DISTANCES_M:
        for angle_degrees in ANGLES_DEGREES:
            shares = [
                recall(camera, detector, criteria, distance_m=distance_m, angle_degrees=angle_degrees, **each)
                for each in CONDITIONS.values()
            ]
            print(
                f'| {distance_m} m | {camera.side_pixels(distance_m):.0f} px | {angle_degrees}° | '
                + ' | '.join(f'{share:.0%}' for share in shares)
                + ' |',
                flush=True,
            )


if __name__ == '__main__':
    main()
