"""COLMAP's database, from which it reads features and matches. Images have numbers as names.

COLMAP splits each line of a list of pairs at spaces, and takes `#` for a comment.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pycolmap


def number_names(count: int) -> list[str]:
    """The names of `count` images in the database."""
    return [f"{number:06d}" for number in range(count)]


def add_camera(database: pycolmap.Database, camera: pycolmap.Camera) -> int:
    """Write a camera, which has its number already. Returns the number of its rig, in which it is alone."""
    database.write_camera(camera, use_camera_id=True)
    rig = pycolmap.Rig()
    rig.add_ref_sensor(camera.sensor_id)
    return int(database.write_rig(rig))


def add_image(database: pycolmap.Database, name: str, features: str, camera: int, rig: int) -> int:
    """Write an image with the features of an .npz file. Returns its number."""
    image = pycolmap.Image(name=name, camera_id=camera)
    image.image_id = database.write_image(image)
    frame = pycolmap.Frame()
    frame.rig_id = rig
    frame.add_data_id(image.data_id)
    database.write_frame(frame)
    with np.load(features) as found:
        descriptors = pycolmap.FeatureDescriptors(type=pycolmap.FeatureExtractorType.SIFT, data=found["descriptors"])
        database.write_keypoints(image.image_id, found["keypoints"])
        database.write_descriptors(image.image_id, descriptors)
    return int(image.image_id)


def write_pairs(database: Path, pairs: Sequence[tuple[str, str]]) -> pycolmap.ImportedPairingOptions:
    """Write pairs of names to a file beside the database, which the options name."""
    listed = database.with_suffix(".txt")
    listed.write_text("".join(f"{first} {second}\n" for first, second in pairs), encoding="ascii")
    options = pycolmap.ImportedPairingOptions()
    options.match_list_path = str(listed)
    return options
