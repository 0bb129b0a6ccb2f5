"""Plane-sweep stereo: a depth map of a keyframe, the reference view, from its source views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.capture.loading import downscaled
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.prior.depth_range import DepthRange
from pocketgs.prior.matching_cost import ALL_USABLE, BITS, SourceViews, matching_costs, squares_of
from pocketgs.prior.semi_global import EIGHT_PATHS, FOUR_PATHS, aggregate, winners

SMOOTHING_WINDOW, SMOOTHING_WIDTH, SMOOTHING_STEPS = 9, 4.0, 3.0
"""Side and standard deviation in pixels of the window of the bilateral filter, and its standard deviation in
hypotheses."""

MAX_PIXELS = 400_000
"""Maximum size of a sweep; larger frames are reduced. It bounds memory and time."""

BASELINE_SPREAD = 0.5
"""Standard deviation of the baseline score, relative to the target baseline."""

THIRD_VIEW = 0.2
"""Weight of a source view where two better ones see the same point: only the best two costs are averaged."""


@dataclass(frozen=True)
class SweepSettings:
    """Settings of the sweep.

    Attributes:
        source_views: number of source views per keyframe.
        paths: directions of semi-global matching, 4 or 8.
        small_step, large_step: its penalties, in census bits.
        angle: target angle of the baseline as seen from the scene, in radians.
        least_angle: source views with a smaller viewing angle count less, in radians.

    Raises:
        PocketGSError: a number is out of range.
    """

    source_views: int = 4
    paths: int = 8
    small_step: int = 8
    large_step: int = 60
    angle: float = np.radians(8)
    least_angle: float = np.radians(4)

    def __post_init__(self) -> None:
        if self.source_views < 1:
            raise PocketGSError(f"source views: found {self.source_views}, expected at least 1")
        if self.paths not in (4, 8):
            raise PocketGSError(f"paths of semi-global matching: found {self.paths}, expected 4 or 8")


@dataclass(frozen=True)
class DepthMap:
    """The result of a sweep for one keyframe.

    Attributes:
        depth: (H, W) float32 along the optical axis, 0 where unknown.
        margin: (H, W) float32 in [0, 1]: share by which the depth is cheaper than the next best.
        step: difference in inverse depth of neighbouring hypotheses.
    """

    depth: np.ndarray
    margin: np.ndarray
    step: float

    @property
    def resolved(self) -> float:
        """Depth beyond which points shift by less than one hypothesis, so that their distance cannot be measured."""
        return 1 / self.step


def at_sweep_size(frame: Frame, most_pixels: int = MAX_PIXELS) -> Frame:
    """The frame, reduced if it exceeds the size of a sweep."""
    width, height = frame.camera.width, frame.camera.height
    reduction = np.sqrt(width * height / most_pixels)
    return downscaled(frame, float(reduction), None) if reduction > 1 else frame


def choose_source_views(
    keyframe: Frame, frames: Sequence[Frame], points: np.ndarray, settings: SweepSettings
) -> list[Frame]:
    """Choose the source views of a keyframe such that two of them see most of what it sees, from a good angle.

    A frame's score at a point is exp(-(b - b_target)² / 2 σ²) · min(α / α_min, 1), where b is the baseline and α the
    viewing angle at the point; 0 if it does not see the point. Frames are chosen one by one by what they add to the two
    best scores of all points.

    Args:
        keyframe: the reference view.
        frames: to choose from; the keyframe itself is skipped.
        points: (N, 3) points that the keyframe sees.
        settings: number of source views, and angles.
    """
    others = [frame for frame in frames if frame.name != keyframe.name]
    scores = np.array([_scores(keyframe.camera, other.camera, points, settings) for other in others])
    best, second = np.zeros((2, len(points)))
    chosen: list[int] = []
    for _ in range(min(settings.source_views, len(others))):
        added = np.maximum(scores, second) - second + THIRD_VIEW * scores
        added[chosen] = -1.0
        index = int(np.argmax(added.sum(axis=1)))
        if not scores[index].any():
            break
        chosen.append(index)
        second = np.maximum(second, np.minimum(best, scores[index]))
        best = np.maximum(best, scores[index])
    return [others[index] for index in chosen]


def _scores(view: Camera, other: Camera, points: np.ndarray, settings: SweepSettings) -> np.ndarray:
    """(N,) score of another camera for estimating the depths of points."""
    pixels, depth = other.project(points)
    seen = (depth > 0) & np.all((pixels >= 0) & (pixels < (other.width, other.height)), axis=1)
    here, there = view.centre - points, other.centre - points
    distances = np.linalg.norm(here, axis=1)
    cosine = np.sum(here * there, axis=1) / np.maximum(distances * np.linalg.norm(there, axis=1), 1e-30)
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    target = np.tan(settings.angle) * distances
    baseline = np.linalg.norm(view.centre - other.centre)
    fit = np.exp(-((baseline / target - 1) ** 2) / (2 * BASELINE_SPREAD**2))
    return np.where(seen, fit * np.minimum(angle / settings.least_angle, 1.0), 0.0)


def sweep(keyframe: Frame, source_views: Sequence[Frame], search: DepthRange, settings: SweepSettings) -> DepthMap:
    """Compute the depth map of a keyframe.

    Pixels excluded by a mask or alpha get no depth. Masked pixels, here or in source views, do not influence others;
    transparent pixels do: they show the background and mark the object's outline.

    Args:
        keyframe: the reference view.
        source_views: if empty, no depth is known.
        search: the depths to test.
        settings: of the sweep.
    """
    view = _grey(keyframe)
    inverse_depths = search.inverse_depths
    step = float(inverse_depths[1] - inverse_depths[0])
    if not source_views:
        return DepthMap(np.zeros(view.shape, np.float32), np.zeros(view.shape, np.float32), step)
    costs = matching_costs(view, _source_views(keyframe.camera, source_views), inverse_depths)
    if keyframe.mask is not None:
        costs[~keyframe.mask] = BITS // 2  # as for hypotheses that no source view sees
    paths = EIGHT_PATHS if settings.paths == 8 else FOUR_PATHS
    total = aggregate(costs, view, paths, settings.small_step, settings.large_step)
    depth, margin = winners(total, inverse_depths, len(paths))
    if np.isfinite(search.farthest):  # the true depth may be outside the range
        depth[depth * inverse_depths[0] > 1 - 1e-6] = 0
    if keyframe.usable is not None:
        depth[~keyframe.usable] = 0
    return DepthMap(_smoothed(depth, step), margin, step)


def _smoothed(depth: np.ndarray, spacing: float) -> np.ndarray:
    """Remove the steps between hypotheses on slanted surfaces.

    A bilateral filter on inverse depth, which is linear in pixels on a plane of any slant: the mean over a symmetric
    window is unbiased there, and edges of more than a few hypotheses are kept.
    """
    known = depth > 0
    # Unknown depths are set so far from all others that they do not take part in any mean.
    elsewhere = np.full_like(depth, -10 * SMOOTHING_STEPS * spacing)
    inverse = np.divide(1.0, depth, out=elsewhere, where=known)
    smooth = cv2.bilateralFilter(inverse, SMOOTHING_WINDOW, SMOOTHING_STEPS * spacing, SMOOTHING_WIDTH)
    return np.divide(1.0, smooth, out=np.zeros_like(depth), where=known)


def _grey(frame: Frame) -> np.ndarray:
    """The greyscale image, black where it is masked, so that masked pixels have no influence."""
    grey = cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY)
    if frame.mask is not None:
        grey[~frame.mask] = 0
    return grey


def _source_views(view: Camera, frames: Sequence[Frame]) -> SourceViews:
    """The source views' images, and the mapping of pixels into them: K_s (R K⁻¹ (x, y, 1) + i t)."""
    images = [_grey(frame) for frame in frames]
    sizes = np.array([image.shape for image in images])
    squares = np.zeros((len(images), *sizes.max(axis=0)), np.uint32)
    turns, shifts = np.empty((len(images), 3, 3), np.float32), np.empty((len(images), 3), np.float32)
    for index, (image, frame) in enumerate(zip(images, frames, strict=True)):
        squares[index, : image.shape[0], : image.shape[1]] = squares_of(image)
        relative = frame.camera.world_to_camera @ view.camera_to_world
        turns[index] = frame.camera.intrinsic_matrix @ relative[:3, :3] @ np.linalg.inv(view.intrinsic_matrix)
        shifts[index] = frame.camera.intrinsic_matrix @ relative[:3, 3]
    return SourceViews(squares, sizes.astype(np.float32), turns, shifts, _usable_of(frames, squares.shape))


def _usable_of(frames: Sequence[Frame], shape: tuple[int, ...]) -> np.ndarray:
    """Unmasked pixels of the source views, padded to one size."""
    if all(frame.mask is None for frame in frames):
        return ALL_USABLE
    usable = np.ones(shape, np.bool_)
    for padded, frame in zip(usable, frames, strict=True):
        if frame.mask is not None:
            padded[: frame.mask.shape[0], : frame.mask.shape[1]] = frame.mask
    return usable
