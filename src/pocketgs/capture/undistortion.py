"""Undistortion of images to pinhole images."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.geometry.lens import PINHOLE, Lens, undistort

# Number of samples along each side of an image's border.
BORDER_SAMPLES = 129

MAX_KEPT = 4
"""Lenses whose maps are kept: most captures have one, and rigs a few."""

MAP_PIXEL = 8
"""Bytes of the maps per pixel of the result."""

# OpenCV's remap cannot address larger images.
MAX_REMAPPED_SIDE = 32_766


@dataclass(frozen=True, eq=False)
class Undistortion:
    """Maps that resample a distorted image to a pinhole image.

    Attributes:
        left, top: position of the result's top left pixel in the distorted image's pixel grid; may be negative.
        width, height: size of the result in pixels.
        map_x, map_y: (height, width) float32, position of each result pixel in the distorted image, in OpenCV's
            convention (pixel centres at integers), for `cv2.remap`.
    """

    left: int
    top: int
    width: int
    height: int
    map_x: np.ndarray
    map_y: np.ndarray

    def view(self, camera: Camera) -> Camera:
        """The pinhole camera of the result, with the focal lengths of the distorted image's camera."""
        return replace(camera.cropped(self.left, self.top, self.width, self.height), lens=PINHOLE)

    def apply(self, image: np.ndarray, interpolation: int) -> np.ndarray:
        """Undistort an (H, W[, C]) image; `interpolation` is one of `cv2.INTER_…`."""
        return cv2.remap(image, self.map_x, self.map_y, interpolation, borderMode=cv2.BORDER_REPLICATE)


def undistortion(camera: Camera, lens: Lens) -> Undistortion:
    """Compute the maps, with the result cropped to a rectangle that shows only what the distorted image shows.

    Args:
        camera: intrinsics and size of the distorted image.
        lens: its distortion.

    Raises:
        PocketGSError: the image is too large to remap, or no usable rectangle is left.
    """
    return _undistortion(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, lens)


def forget_undistortions() -> None:
    """Free the cached maps."""
    _undistortion.cache_clear()


@lru_cache(maxsize=MAX_KEPT)
def _undistortion(width: int, height: int, fx: float, fy: float, cx: float, cy: float, lens: Lens) -> Undistortion:
    camera = Camera(width, height, fx, fy, cx, cy, np.eye(4))
    left, top, right, bottom = inner_rectangle(camera, lens)
    view = camera.cropped(left, top, right - left, bottom - top)
    for image in (camera, view):
        if max(image.width, image.height) > MAX_REMAPPED_SIDE:
            raise PocketGSError(
                f"undistortion: an image of {image.width}x{image.height} pixels, "
                f"expected at most {MAX_REMAPPED_SIDE} a side"
            )
    size = (view.width, view.height)
    matrices = _opencv_matrix(camera), _opencv_matrix(view)
    coefficients = np.array(lens.coefficients)
    make_map = cv2.fisheye.initUndistortRectifyMap if lens.model == "fisheye" else cv2.initUndistortRectifyMap
    map_x, map_y = make_map(matrices[0], coefficients, np.eye(3), matrices[1], size, cv2.CV_32FC1)
    # If the optical axis lies outside the image, the assumptions of inner_rectangle may not hold.
    if not _within(map_x, width) or not _within(map_y, height):
        raise _no_usable_part(camera, lens)
    return Undistortion(left, top, *size, map_x, map_y)


def inner_rectangle(camera: Camera, lens: Lens) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of the largest pinhole image that shows only what the distorted one shows.

    Each side is where the undistorted border of the image reaches furthest inwards.

    Args:
        camera: intrinsics and size of the distorted image.
        lens: its distortion.

    Returns:
        Integers in the distorted image's pixel grid, right and bottom exclusive.

    Raises:
        PocketGSError: the rectangle would be empty or many times larger than the image.
    """
    # The outermost pixel centres: between them interpolation stays inside the image.
    x = np.linspace(0.5, camera.width - 0.5, BORDER_SAMPLES)
    y = np.linspace(0.5, camera.height - 0.5, BORDER_SAMPLES)
    borders = [(x[:1], y), (x[-1:], y), (x, y[:1]), (x, y[-1:])]
    pixels = np.concatenate([np.stack(np.broadcast_arrays(*border), axis=1) for border in borders])
    seen = undistorted_pixels(camera, lens, pixels).reshape(4, BORDER_SAMPLES, 2)
    left, right, top, bottom = seen[0, :, 0].max(), seen[1, :, 0].min(), seen[2, :, 1].max(), seen[3, :, 1].min()
    if not (1 <= right - left <= 4 * camera.width and 1 <= bottom - top <= 4 * camera.height):
        raise _no_usable_part(camera, lens)
    # Rounding guards against errors in the last digit; centres are at + 0.5.
    return (
        math.ceil(round(left - 0.5, 6)),
        math.ceil(round(top - 0.5, 6)),
        math.floor(round(right + 0.5, 6)),
        math.floor(round(bottom + 0.5, 6)),
    )


def undistorted_pixels(camera: Camera, lens: Lens, pixels: np.ndarray) -> np.ndarray:
    """Undistort pixel positions: where a pinhole camera of the same intrinsics sees them.

    Args:
        camera: the intrinsics.
        lens: the distortion.
        pixels: (N, 2), pixel centres at + 0.5.

    Returns:
        (N, 2) pixels. Pixels that cannot be undistorted get the furthest valid position towards them.
    """
    focal, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    return undistort(lens, (pixels - centre) / focal) * focal + centre


def _within(positions: np.ndarray, side: int) -> bool:
    """Whether pixel positions, centres at integers, lie in an image of that side, to within half a pixel."""
    return bool(positions.min() > -0.5 and positions.max() < side - 0.5)


def _no_usable_part(camera: Camera, lens: Lens) -> PocketGSError:
    return PocketGSError(
        f"undistortion: {lens.model} coefficients {lens.coefficients} leave no usable part of an image of "
        f"{camera.width}x{camera.height} pixels with focal lengths {camera.fx:g}, {camera.fy:g} and "
        f"principal point {camera.cx:g}, {camera.cy:g}"
    )


def _opencv_matrix(camera: Camera) -> np.ndarray:
    """The camera's intrinsic matrix with pixel centres at integers, OpenCV's convention."""
    matrix = camera.intrinsic_matrix.copy()
    matrix[:2, 2] -= 0.5
    return matrix
