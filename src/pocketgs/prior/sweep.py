"""Plane-sweep stereo: a depth for every pixel of a keyframe, from frames that see the same."""

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
"""Side and standard deviation in pixels of the window in which depths are smoothed, and, in hypotheses, that of what
counts as the same surface."""

MAX_PIXELS = 400_000
"""Larger frames are searched at a smaller size: it bounds the memory and the time of a sweep."""

BASELINE_SPREAD = 0.5
"""Standard deviation of the baseline's score, as a share of the baseline aimed at."""

THIRD_VIEW = 0.2
"""What a source view counts for where two better ones see the same point: their costs are what is averaged."""


@dataclass(frozen=True)
class SweepSettings:
    """How depths are searched.

    Attributes:
        source_views: frames that a keyframe is compared with.
        paths: directions of semi-global matching, 4 or 8.
        small_step, large_step: its penalties, in census bits.
        angle: that the baseline to a source view should span, seen from the scene, in radians.
        least_angle: a source view whose viewing angle is smaller counts less, in radians.

    Raises:
        PocketGSError: a number makes no sense.
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
    """What a sweep found for one keyframe.

    Attributes:
        depth: (H, W) float32 along the optical axis, 0 where unknown.
        margin: (H, W) float32 in [0, 1]: by what share the depth is cheaper than the best other one.
        step: by how much the inverse depths of neighbouring hypotheses differ.
    """

    depth: np.ndarray
    margin: np.ndarray
    step: float

    @property
    def resolved(self) -> float:
        """Depth beyond which things shift by less than one hypothesis: how far away they are cannot be told."""
        return 1 / self.step


def at_sweep_size(frame: Frame, most_pixels: int = MAX_PIXELS) -> Frame:
    """The frame, smaller if it has more pixels than a sweep takes."""
    width, height = frame.camera.width, frame.camera.height
    reduction = np.sqrt(width * height / most_pixels)
    return downscaled(frame, float(reduction), None) if reduction > 1 else frame


def choose_source_views(
    keyframe: Frame, frames: Sequence[Frame], points: np.ndarray, settings: SweepSettings
) -> list[Frame]:
    """The frames to compare a keyframe with, so that most of what it sees is seen well by two of them.

    A frame's score at a point is exp(-(b - b_target)² / 2 σ²) · min(α / α_min, 1), where b is the baseline and α the
    viewing angle at the point; 0 where it does not see the point. Frames are chosen one by one, each for what it adds
    to the two best scores of every point.

    Args:
        keyframe: the frame whose depth is sought.
        frames: to choose from; the keyframe itself is passed over.
        points: (N, 3) what the keyframe sees.
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
    """(N,) how well another camera helps to tell the depths of points."""
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
    """Find the depths of a keyframe.

    Pixels that a mask or alpha leaves out have no depth; those that a mask leaves out, here or in source views, have no
    say in that of others. What alpha leaves out lies on the background and tells where an object ends.

    Args:
        keyframe: the frame whose depth is sought.
        source_views: frames to compare it with; without any, no depth is known.
        search: the depths to try.
        settings: how.
    """
    view = _grey(keyframe)
    inverse_depths = search.inverse_depths
    step = float(inverse_depths[1] - inverse_depths[0])
    if not source_views:
        return DepthMap(np.zeros(view.shape, np.float32), np.zeros(view.shape, np.float32), step)
    costs = matching_costs(view, _source_views(keyframe.camera, source_views), inverse_depths)
    if keyframe.mask is not None:
        costs[~keyframe.mask] = BITS // 2  # as where no source view sees a hypothesis
    paths = EIGHT_PATHS if settings.paths == 8 else FOUR_PATHS
    total = aggregate(costs, view, paths, settings.small_step, settings.large_step)
    depth, margin = winners(total, inverse_depths, len(paths))
    if np.isfinite(search.farthest):  # the truth may lie beyond the end of the range
        depth[depth * inverse_depths[0] > 1 - 1e-6] = 0
    if keyframe.usable is not None:
        depth[~keyframe.usable] = 0
    return DepthMap(_smoothed(depth, step), margin, step)


def _smoothed(depth: np.ndarray, spacing: float) -> np.ndarray:
    """Depths without the steps that hypotheses leave on slanted surfaces.

    A bilateral filter on inverse depth, which is linear in pixels on a plane, whatever its slant: the mean over a
    symmetric window is unbiased there, and edges of more than a few hypotheses stay.
    """
    known = depth > 0
    # Unknown depths lie so far from all others that none takes part in a mean.
    elsewhere = np.full_like(depth, -10 * SMOOTHING_STEPS * spacing)
    inverse = np.divide(1.0, depth, out=elsewhere, where=known)
    smooth = cv2.bilateralFilter(inverse, SMOOTHING_WINDOW, SMOOTHING_STEPS * spacing, SMOOTHING_WIDTH)
    return np.divide(1.0, smooth, out=np.zeros_like(depth), where=known)


def _grey(frame: Frame) -> np.ndarray:
    """The grey image, black where it is masked: whatever is there has no say."""
    grey = cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY)
    if frame.mask is not None:
        grey[~frame.mask] = 0
    return grey


def _source_views(view: Camera, frames: Sequence[Frame]) -> SourceViews:
    """The source views' images, and how pixels of the view fall into them: K_s (R K⁻¹ (x, y, 1) + i t)."""
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
    """What the masks of the source views leave, padded to one size."""
    if all(frame.mask is None for frame in frames):
        return ALL_USABLE
    usable = np.ones(shape, np.bool_)
    for padded, frame in zip(usable, frames, strict=True):
        if frame.mask is not None:
            padded[: frame.mask.shape[0], : frame.mask.shape[1]] = frame.mask
    return usable
