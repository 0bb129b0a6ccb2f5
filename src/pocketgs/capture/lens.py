"""Lens distortion, and the pinhole image that undoing it gives.

Normalised coordinates are (x/z, y/z) in the camera's axes: what intrinsics turn into pixels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera

COEFFICIENT_COUNTS = {"opencv": (0, 4, 5, 8), "fisheye": (4,)}

# A pinhole image stretches without bound towards 90 degrees off axis: what lies beyond this is cropped away.
LARGEST_HALF_FIELD = math.radians(75)

# Radians off axis by which one stride of `undistort` may change a point.
LARGEST_LEAP = 0.2

# Points at which each side of an image's border is followed through the lens.
BORDER_SAMPLES = 129

# OpenCV's remap cannot address larger images.
LARGEST_REMAPPED_SIDE = 32_766


@dataclass(frozen=True)
class Lens:
    """Distortion in one of OpenCV's two models.

    Attributes:
        model: "opencv" (k1, k2, p1, p2[, k3[, k4, k5, k6]]) or "fisheye" (k1, k2, k3, k4, equidistant).
        coefficients: in OpenCV's order; empty means no distortion for "opencv".

    Raises:
        PocketGSError: the model is unknown, the number of coefficients is not its own, or one is not finite.
    """

    model: str = "opencv"
    coefficients: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        counts = COEFFICIENT_COUNTS.get(self.model)
        if counts is None:
            raise PocketGSError(f"lens: model {self.model!r}, expected one of {', '.join(COEFFICIENT_COUNTS)}")
        if len(self.coefficients) not in counts or not all(map(math.isfinite, self.coefficients)):
            raise PocketGSError(f"lens: coefficients {self.coefficients}, expected {counts} finite numbers")

    @property
    def distorts(self) -> bool:
        """Whether the lens shows anything else than a pinhole camera would."""
        return self.model == "fisheye" or any(self.coefficients)


PINHOLE = Lens()


@dataclass(frozen=True, eq=False)
class Undistortion:
    """How to make a pinhole image of a distorted one.

    Attributes:
        left, top: where the top left pixel of the result lies in the distorted image's pixel grid; may be negative.
        width, height: size of the result in pixels.
        map_x, map_y: (height, width) float32, for each pixel of the result where its colour lies in the distorted
            image, in OpenCV's convention (pixel centres at integers), as `cv2.remap` takes them.
    """

    left: int
    top: int
    width: int
    height: int
    map_x: np.ndarray
    map_y: np.ndarray

    def view(self, camera: Camera) -> Camera:
        """The pinhole camera of the result, from the camera of the distorted image. Focal lengths stay."""
        return camera.cropped(self.left, self.top, self.width, self.height)

    def apply(self, image: np.ndarray, interpolation: int) -> np.ndarray:
        """The pinhole image of a distorted (H, W[, C]) one; `interpolation` is one of `cv2.INTER_…`."""
        return cv2.remap(image, self.map_x, self.map_y, interpolation, borderMode=cv2.BORDER_REPLICATE)


def undistortion(camera: Camera, lens: Lens) -> Undistortion:
    """How to undo a lens, with the result cropped to a rectangle that shows only what the distorted image saw.

    Args:
        camera: intrinsics and size of the distorted image.
        lens: its distortion.

    Raises:
        PocketGSError: the image is too large to remap, or no usable rectangle is left.
    """
    return _undistortion(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, lens)


def forget_undistortions() -> None:
    """Free the maps that `undistortion` keeps for the next image of the same lens."""
    _undistortion.cache_clear()


# Most captures have one lens; a few entries also serve rigs, and the maps of a large image take many megabytes.
@lru_cache(maxsize=4)
def _undistortion(width: int, height: int, fx: float, fy: float, cx: float, cy: float, lens: Lens) -> Undistortion:
    camera = Camera(width, height, fx, fy, cx, cy, np.eye(4))
    left, top, right, bottom = inner_rectangle(camera, lens)
    view = camera.cropped(left, top, right - left, bottom - top)
    for image in (camera, view):
        if max(image.width, image.height) > LARGEST_REMAPPED_SIDE:
            raise PocketGSError(
                f"undistortion: an image of {image.width}x{image.height} pixels, "
                f"expected at most {LARGEST_REMAPPED_SIDE} a side"
            )
    size = (view.width, view.height)
    matrices = _opencv_matrix(camera), _opencv_matrix(view)
    coefficients = np.array(lens.coefficients)
    make_map = cv2.fisheye.initUndistortRectifyMap if lens.model == "fisheye" else cv2.initUndistortRectifyMap
    map_x, map_y = make_map(matrices[0], coefficients, np.eye(3), matrices[1], size, cv2.CV_32FC1)
    # Where the optical axis lies outside the image the reasoning of inner_rectangle may not hold.
    if not _within(map_x, width) or not _within(map_y, height):
        raise _no_usable_part(camera, lens)
    return Undistortion(left, top, *size, map_x, map_y)


def inner_rectangle(camera: Camera, lens: Lens) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of the largest pinhole image that shows only what the distorted one saw.

    Each side lies where the undistorted border of the image reaches furthest inwards.

    Args:
        camera: intrinsics and size of the distorted image.
        lens: its distortion.

    Returns:
        Integers in the distorted image's pixel grid, right and bottom exclusive.

    Raises:
        PocketGSError: the rectangle would be empty or many times larger than the image.
    """
    # The outermost pixel centres: between them interpolation never needs a pixel that is not there.
    x = np.linspace(0.5, camera.width - 0.5, BORDER_SAMPLES)
    y = np.linspace(0.5, camera.height - 0.5, BORDER_SAMPLES)
    borders = [(x[:1], y), (x[-1:], y), (x, y[:1]), (x, y[-1:])]
    pixels = np.concatenate([np.stack(np.broadcast_arrays(*border), axis=1) for border in borders])
    seen = undistorted_pixels(camera, lens, pixels).reshape(4, BORDER_SAMPLES, 2)
    left, right, top, bottom = seen[0, :, 0].max(), seen[1, :, 0].min(), seen[2, :, 1].max(), seen[3, :, 1].min()
    if not (1 <= right - left <= 4 * camera.width and 1 <= bottom - top <= 4 * camera.height):
        raise _no_usable_part(camera, lens)
    # Rounding guards against a border that is exact but for the last digit; centres lie at + 0.5.
    return (
        math.ceil(round(left - 0.5, 6)),
        math.ceil(round(top - 0.5, 6)),
        math.floor(round(right + 0.5, 6)),
        math.floor(round(bottom + 0.5, 6)),
    )


def undistorted_pixels(camera: Camera, lens: Lens, pixels: np.ndarray) -> np.ndarray:
    """Where a pinhole camera of the same intrinsics sees what a distorting one sees at `pixels`.

    Args:
        camera: the intrinsics.
        lens: the distortion.
        pixels: (N, 2), pixel centres at + 0.5.

    Returns:
        (N, 2) pixels. A pixel beyond what can be undone is given the furthest place towards it that can.
    """
    focal, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    return undistort(lens, (pixels - centre) / focal) * focal + centre


def distort(lens: Lens, points: np.ndarray) -> np.ndarray:
    """Where a lens shows points: (N, 2) normalised coordinates to (N, 2) distorted ones."""
    x, y = points[:, 0], points[:, 1]
    square = x * x + y * y
    if lens.model == "fisheye":
        radius = np.maximum(np.sqrt(square), 1e-12)
        angle = np.arctan(radius)
        powers = angle[:, None] ** np.array([2, 4, 6, 8])
        return points * (angle * (1 + powers @ np.array(lens.coefficients)) / radius)[:, None]
    k1, k2, p1, p2, k3, k4, k5, k6 = (*lens.coefficients, *[0.0] * (8 - len(lens.coefficients)))
    radial = (1 + square * (k1 + square * (k2 + square * k3))) / (1 + square * (k4 + square * (k5 + square * k6)))
    across = x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x)
    down = y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y
    return np.stack([across, down], axis=1)


def undistort(lens: Lens, points: np.ndarray, rounds: int = 48) -> np.ndarray:
    """The inverse of `distort`, for the part of the image around the optical axis where there is one.

    Each point is approached from the axis in strides, each solved by Newton's method and halved where that fails.
    This follows the inverse that belongs to the lens (a polynomial has others), and where it ends, at a fold of the
    polynomial or at `LARGEST_HALF_FIELD`, the point stays at the last place reached. OpenCV's own iteration diverges
    there.

    Args:
        lens: the distortion.
        points: (N, 2) distorted normalised coordinates.
        rounds: most strides to try; more end closer to the fold.

    Returns:
        (N, 2) normalised coordinates.
    """
    found = np.zeros_like(points)
    reached = np.zeros((len(points), 1))
    stride = np.full((len(points), 1), 1 / 8)
    with np.errstate(all="ignore"):
        for _ in range(rounds):
            if np.all(reached == 1):
                break
            fraction = np.minimum(reached + stride, 1)
            guess, accepted = _follow(lens, found, points * fraction)
            found = np.where(accepted, guess, found)
            reached = np.where(accepted, fraction, reached)
            stride = np.where(accepted, stride, stride / 2)
    return found


def _follow(lens: Lens, start: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Newton's method from `start` to where the lens shows `target`.

    Returns:
        (N, 2) normalised coordinates, and (N, 1) whether they are the solution that belongs to the lens.
    """
    guess = start
    for _ in range(4):
        jacobian, value = _jacobian(lens, guess)
        guess = guess + _solve(jacobian, target - value)
    solved = np.abs(distort(lens, guess) - target).max(axis=1) < 1e-8
    # Once the derivative in x or y, or the determinant, has changed sign the lens has folded the image over.
    unfolded = (jacobian[:, 0, 0] > 0) & (jacobian[:, 1, 1] > 0) & (_determinant(jacobian) > 0)
    angle, start_angle = (np.arctan(np.linalg.norm(points, axis=1)) for points in (guess, start))
    # Near a fold Newton's method may leap to another branch.
    near = np.abs(angle - start_angle) < LARGEST_LEAP
    return guess, (solved & unfolded & near & (angle < LARGEST_HALF_FIELD))[:, None]


def _jacobian(lens: Lens, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N, 2, 2) derivative of `distort` by central differences, and its (N, 2) value."""
    small = 1e-6
    columns = [
        (distort(lens, points + offset) - distort(lens, points - offset)) / (2 * small)
        for offset in (np.array([small, 0.0]), np.array([0.0, small]))
    ]
    return np.stack(columns, axis=2), distort(lens, points)


def _determinant(matrices: np.ndarray) -> np.ndarray:
    return matrices[:, 0, 0] * matrices[:, 1, 1] - matrices[:, 0, 1] * matrices[:, 1, 0]


def _solve(matrices: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve (N, 2, 2) systems by Cramer's rule, so that a singular one gives infinities and no exception."""
    across = right[:, 0] * matrices[:, 1, 1] - right[:, 1] * matrices[:, 0, 1]
    down = right[:, 1] * matrices[:, 0, 0] - right[:, 0] * matrices[:, 1, 0]
    return np.stack([across, down], axis=1) / _determinant(matrices)[:, None]


def _within(positions: np.ndarray, side: int) -> bool:
    """Whether pixel positions, centres at integers, lie in an image of that side but for less than half a pixel."""
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
