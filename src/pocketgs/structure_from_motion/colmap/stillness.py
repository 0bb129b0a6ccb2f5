"""Captures whose camera stands still: COLMAP would look for two images to start from for a long time, in vain."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import pycolmap

STILL = 0.01
"""Shift of the matches of a pair, as a share of the image's diagonal, below which the camera stands still."""

STILL_SHARE = 0.9
"""Share of such pairs from which the whole capture does: the others show what moved before the camera."""


def stands_still(shifts: Iterable[np.ndarray]) -> bool:
    """Whether the camera of a capture stands still.

    Args:
        shifts: of each matching pair, (M, 2) by how much its M matches shift, in diagonals of the image.
    """
    medians = [float(np.median(np.linalg.norm(pair, axis=1))) for pair in shifts]
    return len(medians) > 0 and float(np.mean(np.array(medians) < STILL)) >= STILL_SHARE


def match_shifts(
    database: pycolmap.Database, numbers: Sequence[int], geometries: Sequence[pycolmap.TwoViewGeometry]
) -> Iterator[np.ndarray]:
    """Of each matching pair, (M, 2) by how much its matches shift, in diagonals of the image.

    Args:
        database: of the images.
        numbers: of its pairs.
        geometries: of the pairs, with their matches.
    """
    images = {image.image_id: image for image in database.read_all_images()}
    points = {number: database.read_keypoints(number)[:, :2] for number in images}
    sizes = {camera.camera_id: np.hypot(camera.width, camera.height) for camera in database.read_all_cameras()}
    for pair, geometry in zip(numbers, geometries, strict=True):
        first, second = pycolmap.pair_id_to_image_pair(pair)
        matches = np.asarray(geometry.inlier_matches).reshape(-1, 2)
        if len(matches):
            here, there = (
                points[number][column] / sizes[images[number].camera_id]
                for number, column in ((first, matches[:, 0]), (second, matches[:, 1]))
            )
            yield there - here
