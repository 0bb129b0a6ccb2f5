"""Plane-sweep stereo: what a sweep is, and what it gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.capture.frame_edits import downscaled
from pocketgs.errors import PocketGSError
from pocketgs.prior.depth.depth_range import DepthRange

MAX_PIXELS = 400_000
"""Maximum size of a sweep; larger frames are reduced. It bounds memory and time."""


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


def no_depth(keyframe: Frame, search: DepthRange) -> DepthMap:
    """The depth map of a keyframe without source views."""
    shape = keyframe.image.shape[:2]
    return DepthMap(np.zeros(shape, np.float32), np.zeros(shape, np.float32), step_of(search.inverse_depths))


def step_of(inverse_depths: np.ndarray) -> float:
    """Difference of neighbouring hypotheses."""
    return float(inverse_depths[1] - inverse_depths[0])


def at_sweep_size(frame: Frame, most_pixels: int = MAX_PIXELS) -> Frame:
    """The frame, reduced if it exceeds the size of a sweep."""
    width, height = frame.camera.width, frame.camera.height
    reduction = np.sqrt(width * height / most_pixels)
    return downscaled(frame, float(reduction), None) if reduction > 1 else frame
