"""The contents of a COLMAP sparse model, independent of the encoding."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pocketgs.errors import PocketGSError, clipped
from pocketgs.geometry.lens import PINHOLE, Lens


@dataclass(frozen=True)
class CameraModel:
    """One of COLMAP's camera models.

    Attributes:
        name: COLMAP's name for it.
        parameters: the parameters' names, in COLMAP's order.
        fisheye: whether the distortion is OpenCV's fisheye model.
    """

    name: str
    parameters: tuple[str, ...]
    fisheye: bool = False


# By the model's number in cameras.bin.
CAMERA_MODELS = {
    0: CameraModel("SIMPLE_PINHOLE", ("f", "cx", "cy")),
    1: CameraModel("PINHOLE", ("fx", "fy", "cx", "cy")),
    2: CameraModel("SIMPLE_RADIAL", ("f", "cx", "cy", "k1")),
    3: CameraModel("RADIAL", ("f", "cx", "cy", "k1", "k2")),
    4: CameraModel("OPENCV", ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")),
    5: CameraModel("OPENCV_FISHEYE", ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"), fisheye=True),
    6: CameraModel("FULL_OPENCV", ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
    8: CameraModel("SIMPLE_RADIAL_FISHEYE", ("f", "cx", "cy", "k1"), fisheye=True),
    9: CameraModel("RADIAL_FISHEYE", ("f", "cx", "cy", "k1", "k2"), fisheye=True),
}

UNSUPPORTED_MODELS = {7: 5, 10: 12, 11: 16, 12: 4, 13: 5, 14: 3, 15: 4, 16: 6, 17: 2}
"""COLMAP's other models: by number, how many parameters follow in cameras.bin."""


@dataclass(frozen=True)
class ColmapCamera:
    """The intrinsics of one camera.

    Attributes:
        width, height: image size in pixels.
        focal: fx and fy in pixels.
        centre: cx and cy in pixels, pixel centres at + 0.5.
        lens: the distortion.
    """

    width: int
    height: int
    focal: tuple[float, float]
    centre: tuple[float, float]
    lens: Lens


@dataclass(frozen=True)
class ColmapImage:
    """One registered image.

    Attributes:
        name: path of the file inside the image folder.
        camera_id: which camera took it.
        quaternion: (4,) w, x, y, z of the world-to-camera rotation, OpenCV axes.
        translation: (3,) of world-to-camera.
    """

    name: str
    camera_id: int
    quaternion: np.ndarray
    translation: np.ndarray


def camera_from_parameters(
    model: CameraModel, width: int, height: int, values: list[float], where: str
) -> ColmapCamera:
    """Make a camera from a model and its parameters.

    Raises:
        PocketGSError: a parameter is not finite.
    """
    if not np.all(np.isfinite(values)):
        raise PocketGSError(f"{where}: parameters {clipped(values)}, expected finite numbers")
    named = dict(zip(model.parameters, values, strict=True))
    focal = (named.get("fx", named.get("f", 0.0)), named.get("fy", named.get("f", 0.0)))
    order = ("k1", "k2", "k3", "k4") if model.fisheye else ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    lens = Lens("fisheye" if model.fisheye else "opencv", tuple(named.get(name, 0.0) for name in order))
    return ColmapCamera(width, height, focal, (named["cx"], named["cy"]), lens if lens.distorts else PINHOLE)


def unknown_model(where: str, found: object) -> PocketGSError:
    """The error for an unsupported camera model."""
    known = ", ".join(model.name for model in CAMERA_MODELS.values())
    return PocketGSError(
        f"{where}: camera model {clipped(found)}, expected one of {known}; undistort with COLMAP first"
    )
