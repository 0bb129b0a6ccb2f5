"""Plane-sweep stereo: a depth for every pixel of a keyframe, from the frames around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from pocketgs.camera import Camera
from pocketgs.capture.capture import Frame
from pocketgs.capture.loading import downscaled
from pocketgs.errors import PocketGSError
from pocketgs.prior.matching_cost import References, matching_costs, squares_of
from pocketgs.prior.semi_global import EIGHT_PATHS, FOUR_PATHS, aggregate, winners

FEWEST_HYPOTHESES = 8

SMOOTHING_WINDOW, SMOOTHING_WIDTH, SMOOTHING_STEPS = 9, 4.0, 3.0
"""Side and standard deviation in pixels of the window in which depths are smoothed, and, in hypotheses, that of what
counts as the same surface."""

MOST_PIXELS = 400_000
"""Larger frames are searched at a smaller size: it bounds the memory and the time of a sweep."""


@dataclass(frozen=True)
class SweepSettings:
    """How depths are searched.

    Attributes:
        references: frames that a keyframe is compared with.
        hypotheses: depths tried, uniform in inverse depth.
        paths: directions of semi-global matching, 4 or 8.
        small_step, large_step: its penalties, in census bits.
        angle: that the baseline to a reference should span, seen from the scene, in radians.
        least_angle: a reference whose viewing angle is smaller counts less, in radians.

    Raises:
        PocketGSError: a number makes no sense.
    """

    references: int = 4
    hypotheses: int = 128
    paths: int = 8
    small_step: int = 8
    large_step: int = 60
    angle: float = np.radians(8)
    least_angle: float = np.radians(4)

    def __post_init__(self) -> None:
        if self.references < 1:
            raise PocketGSError(f"references: found {self.references}, expected at least 1")
        if self.hypotheses < FEWEST_HYPOTHESES:
            raise PocketGSError(f"depth hypotheses: found {self.hypotheses}, expected at least {FEWEST_HYPOTHESES}")
        if self.paths not in (4, 8):
            raise PocketGSError(f"paths of semi-global matching: found {self.paths}, expected 4 or 8")


@dataclass(frozen=True)
class DepthMap:
    """What a sweep found for one keyframe.

    Attributes:
        depth: (H, W) float32 along the optical axis, 0 where unknown.
        margin: (H, W) float32 in [0, 1]: by what share the depth is cheaper than the best other one.
    """

    depth: np.ndarray
    margin: np.ndarray


def at_sweep_size(frame: Frame) -> Frame:
    """The frame, smaller if it has more pixels than a sweep takes."""
    width, height = frame.camera.width, frame.camera.height
    reduction = np.sqrt(width * height / MOST_PIXELS)
    return downscaled(frame, float(reduction), None) if reduction > 1 else frame


def choose_references(
    keyframe: Frame, frames: Sequence[Frame], scene_depth: float, settings: SweepSettings
) -> list[Frame]:
    """The frames to compare a keyframe with: those of the highest scores, best first.

    The score is exp(-(b - b_target)² / 2 σ²) · min(α / α_min, 1), where b is the baseline and α the viewing angle at
    the point that lies at the scene's depth before the keyframe.

    Args:
        keyframe: the frame whose depth is sought.
        frames: to choose from; the keyframe itself is passed over.
        scene_depth: median depth of what the keyframe sees.
        settings: number of references, and angles.
    """
    target = float(np.tan(settings.angle)) * scene_depth
    point = keyframe.camera.centre + scene_depth * keyframe.camera.forward

    def score(other: Frame) -> float:
        _, depth = other.camera.project(point[None])
        if depth[0] <= 0:
            return -1.0
        here, there = keyframe.camera.centre - point, other.camera.centre - point
        baseline = float(np.linalg.norm(here - there))
        cosine = here @ there / (np.linalg.norm(here) * np.linalg.norm(there))
        angle = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
        return float(np.exp(-((baseline / target - 1) ** 2) / (2 * 0.5**2))) * min(angle / settings.least_angle, 1.0)

    others = [frame for frame in frames if frame.name != keyframe.name]
    return sorted(others, key=score, reverse=True)[: settings.references]


def sweep(
    keyframe: Frame, references: Sequence[Frame], nearest: float, farthest: float, settings: SweepSettings
) -> DepthMap:
    """Find the depths of a keyframe.

    Pixels that a mask or alpha leaves out have no depth.

    Args:
        keyframe: the frame whose depth is sought.
        references: frames to compare it with; without any, no depth is known.
        nearest: least depth to try.
        farthest: greatest depth to try.
        settings: how.
    """
    view = _grey(keyframe)
    if not references:
        return DepthMap(*np.zeros((2, *view.shape), np.float32))
    inverse_depths = np.linspace(1 / farthest, 1 / nearest, settings.hypotheses, dtype=np.float32)
    costs = matching_costs(view, _references(keyframe.camera, references), inverse_depths)
    paths = EIGHT_PATHS if settings.paths == 8 else FOUR_PATHS
    total = aggregate(costs, view, paths, settings.small_step, settings.large_step)
    depth, margin = winners(total, inverse_depths, len(paths))
    depth = _smoothed(depth, float(inverse_depths[1] - inverse_depths[0]))
    if keyframe.usable is not None:
        depth[~keyframe.usable] = 0
    return DepthMap(depth, margin)


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
    return cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY)


def _references(view: Camera, frames: Sequence[Frame]) -> References:
    """The references' images, and how pixels of the view fall into them: K_r (R K⁻¹ (x, y, 1) + i t)."""
    images = [_grey(frame) for frame in frames]
    sizes = np.array([image.shape for image in images])
    squares = np.zeros((len(images), *sizes.max(axis=0)), np.uint32)
    turns, shifts = np.empty((len(images), 3, 3), np.float32), np.empty((len(images), 3), np.float32)
    for index, (image, frame) in enumerate(zip(images, frames, strict=True)):
        squares[index, : image.shape[0], : image.shape[1]] = squares_of(image)
        relative = frame.camera.world_to_camera @ view.camera_to_world
        turns[index] = frame.camera.intrinsic_matrix @ relative[:3, :3] @ np.linalg.inv(view.intrinsic_matrix)
        shifts[index] = frame.camera.intrinsic_matrix @ relative[:3, 3]
    return References(squares, sizes.astype(np.float32), turns, shifts)
