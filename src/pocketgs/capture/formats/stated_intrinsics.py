"""Intrinsics of a frame in a transforms JSON file, stated as numbers, as fields of view, or as a matrix."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pocketgs.capture.poses import ARKIT_PIXEL_CENTRE
from pocketgs.errors import PocketGSError
from pocketgs.files.json_fields import Fields

NERFCAPTURE_FIELD = "depth_integer_scale"
"""Only the NeRFCapture app writes this field (Manifest.swift in jc211/NeRFCapture), beside ARKit's numbers unchanged.

Other files may use it too; nerfstudio itself does not.
"""

MATRIX_FIELDS = ("K", "intrinsics", "intrinsic_matrix", "camera_intrinsics")
FOCAL_FIELDS, ANGLE_FIELDS = ("fl_x", "fl_y"), ("camera_angle_x", "camera_angle_y")
LENS_FIELDS, LENS_LIST = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"), "distortion_params"
PIXEL_FIELDS = ("fl_x", "fl_y", "cx", "cy", *MATRIX_FIELDS)


REPLACED: tuple[dict[tuple[str, ...], tuple[str, ...]], ...] = (
    {
        FOCAL_FIELDS: (*ANGLE_FIELDS, *MATRIX_FIELDS),
        ANGLE_FIELDS: (*FOCAL_FIELDS, *MATRIX_FIELDS),
        MATRIX_FIELDS: (*FOCAL_FIELDS, *ANGLE_FIELDS, *MATRIX_FIELDS, "cx", "cy"),
    },
    {("w", "h"): ("width", "height"), ("width", "height"): ("w", "h")},
    {LENS_FIELDS: (LENS_LIST,)},
)
"""Fields that mean the same: by those that a frame may state, the whole file's that then no longer hold for it.

Of those in one dictionary a frame may state several; the first counts.
"""


@dataclass(frozen=True)
class Intrinsics:
    """The intrinsics that a frame states.

    Attributes:
        size: width and height in pixels.
        focal: fx and fy in pixels.
        centre: cx and cy in pixels.
    """

    size: tuple[float, float]
    focal: tuple[float, float]
    centre: tuple[float, float]


def read_intrinsics(fields: Fields, image_size: Callable[[], tuple[int, int]]) -> Intrinsics:
    """Read the intrinsics of a frame. A matrix is used only if no focal length or field of view is stated.

    Args:
        fields: the frame's fields, over those of the whole file.
        image_size: returns the size of the image that the frame states, used if no size is stated.

    Raises:
        PocketGSError: no focal length is stated, or a field is malformed.
    """
    width, height = _stated_size(fields) or image_size()
    fx = _focal_length(fields, "fl_x", "camera_angle_x", width)
    fy = _focal_length(fields, "fl_y", "camera_angle_y", height)
    matrix = _matrix(fields) if fx is None and fy is None else None
    if matrix is not None:
        fx, fy = float(matrix[0, 0]), float(matrix[1, 1])
    # Pixels are square unless the file states otherwise.
    fx, fy = (fy if fx is None else fx), (fx if fy is None else fy)
    if fx is None or fy is None:
        raise PocketGSError(f"{fields.where}: no focal length, expected fl_x, camera_angle_x or a 3x3 matrix K")
    middle = (width / 2, height / 2) if matrix is None else (float(matrix[0, 2]), float(matrix[1, 2]))
    cx, cy = _stated_centre(fields)
    return Intrinsics((width, height), (fx, fy), (middle[0] if cx is None else cx, middle[1] if cy is None else cy))


def over_shared(own: Fields, shared: Fields) -> Fields:
    """A frame's fields over those of the whole file, but for what the frame states itself in another way."""
    stated = {name for name, value in own.values.items() if value is not None}
    replaced = ((others for names, others in same.items() if not stated.isdisjoint(names)) for same in REPLACED)
    dropped = {name for others in replaced for name in next(others, ())}
    kept = {name: value for name, value in shared.values.items() if name not in dropped}
    return own.over(Fields(kept, shared.where))


def states_pixels(fields: Fields) -> bool:
    """Whether a frame states intrinsics in pixels, which refer to one image size, unlike fields of view."""
    return any(fields.values.get(name) is not None for name in PIXEL_FIELDS)


def _stated_centre(fields: Fields) -> tuple[float | None, float | None]:
    """The principal point, cx and cy, in pixels, pixel centres at + 0.5; None where not stated."""
    offset = ARKIT_PIXEL_CENTRE if NERFCAPTURE_FIELD in fields.values else 0.0
    cx, cy = fields.optional_number("cx"), fields.optional_number("cy")
    return None if cx is None else cx + offset, None if cy is None else cy + offset


def _stated_size(fields: Fields) -> tuple[float, float] | None:
    for names in (("w", "h"), ("width", "height")):
        width, height = (fields.optional_number(name) for name in names)
        if width is not None and height is not None and (width, height) != (0, 0):
            return width, height
    return None


def _focal_length(fields: Fields, focal_name: str, angle_name: str, side: float) -> float | None:
    """Focal length in pixels, stated or computed from the field of view across `side` pixels; None without either."""
    focal, angle = fields.optional_number(focal_name), fields.optional_number(angle_name)
    if focal is not None or angle is None:
        return focal
    if not 0 < angle < math.pi:
        raise PocketGSError(f"{fields.where}: field '{angle_name}' is {angle:g}, expected radians between 0 and pi")
    return side / (2 * math.tan(angle / 2))


def _matrix(fields: Fields) -> np.ndarray | None:
    """The 3x3 intrinsic matrix, or None if none is stated.

    It may have rows of three or four numbers, or be nine numbers; by rows as usual, or by columns as Apple writes it.
    """
    name = next((name for name in MATRIX_FIELDS if fields.values.get(name) is not None), None)
    if name is None:
        return None
    value = fields.values[name]
    if isinstance(value, list) and len(value) == 9:
        matrix = fields.numbers(name, 9).reshape(3, 3)
    else:
        columns = len(value[0]) if isinstance(value, list) and value and isinstance(value[0], list) else 3
        matrix = fields.matrix(name, columns=4 if columns == 4 else 3)[:3, :3]
    if len(matrix) == 3 and not matrix[:2, 2].any():
        matrix = matrix.T
    if len(matrix) != 3 or not np.allclose(matrix[2], (0, 0, 1)) or matrix[1, 0] != 0:
        raise PocketGSError(f"{fields.where}: field '{name}' is not an intrinsic matrix (fx s cx; 0 fy cy; 0 0 1)")
    return matrix
