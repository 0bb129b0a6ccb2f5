"""Lens models: a simple one while images are placed, and the requested one once many images determine it.

Two or three photographs do not determine two focal lengths and four terms of distortion. Fitted to them, these explain
wrong matches, and further images find no place.
"""

from __future__ import annotations

import numpy as np
import pycolmap

from pocketgs.structure_from_motion.colmap.bundle_adjustment import adjust_bundle
from pocketgs.structure_from_motion.colmap.mapping_job import MappingJob

SIMPLE = {"OPENCV": "SIMPLE_RADIAL", "RADIAL": "SIMPLE_RADIAL", "PINHOLE": "SIMPLE_PINHOLE"}
"""The model with one focal length and at most one term of distortion that images are placed with."""

FAR = 0.1
"""Log ratio above which two focal lengths differ."""

MANY_IMAGES = 10
"""Minimum number of images of a camera to determine more than its simple model."""


def simple_lens(model: str) -> str:
    """COLMAP's name of the lens model that images are placed with, if `model` is requested."""
    return SIMPLE.get(model, model)


def has_square_pixels(camera: pycolmap.Camera) -> bool:
    """Whether the focal lengths along both axes agree: they drift apart where the motion does not determine them."""
    return abs(float(np.log(camera.focal_length_x / camera.focal_length_y))) <= FAR


def with_requested_lenses(job: MappingJob, model: pycolmap.Reconstruction) -> pycolmap.Reconstruction:
    """The model with the requested lenses of cameras with many images, where they make sense.

    Args:
        job: the attempt.
        model: what it has found; not changed.
    """
    requested = {
        number: camera["model"]
        for number, camera in enumerate(job["cameras"], start=1)
        if camera["model"] in SIMPLE and _images(model, number) >= MANY_IMAGES
    }
    if not requested or not job["refine_lenses"]:
        return model
    found = pycolmap.Reconstruction(model)
    for number, name in requested.items():
        _enrich(found.cameras[number], name)
    adjust_bundle(found)
    found.update_point_3d_errors()
    return found if all(has_square_pixels(found.cameras[number]) for number in requested) else model


def _images(model: pycolmap.Reconstruction, camera: int) -> int:
    """Number of placed images of a camera."""
    return sum(image.has_pose and image.camera_id == camera for image in model.images.values())


def _enrich(camera: pycolmap.Camera, name: str) -> None:
    """Turn a camera's simple lens into the same lens of another model, whose further distortion is zero."""
    focal_length, x, y, *distortion = camera.params
    camera.model = getattr(pycolmap.CameraModelId, name)
    focal_lengths, centre, terms = (
        list(places)
        for places in (camera.focal_length_idxs(), camera.principal_point_idxs(), camera.extra_params_idxs())
    )
    parameters = np.zeros(len(focal_lengths) + len(centre) + len(terms))
    parameters[focal_lengths], parameters[centre] = focal_length, (x, y)
    parameters[terms[: len(distortion)]] = distortion
    camera.params = parameters.tolist()
