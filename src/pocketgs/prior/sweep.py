"""Plane-sweep stereo: what a sweep is, and the choice of the device that computes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.capture.loading import downscaled
from pocketgs.errors import PocketGSError
from pocketgs.prior.depth_range import DepthRange
from pocketgs.system.memory_need import MemoryNeed

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


@dataclass(frozen=True)
class SweepExtent:
    """The largest sweep of a run: what the memory that it takes follows from.

    Attributes:
        width, height: of the largest frames, in pixels.
        source_views: number of source views per keyframe.
    """

    width: int
    height: int
    source_views: int

    @property
    def pixels(self) -> int:
        """Pixels of a frame."""
        return self.width * self.height


class Sweeper(Protocol):
    """Sweeps keyframes on one device.

    All sweepers have the same steps: census costs, semi-global matching, winners, a bilateral filter. Pixels excluded
    by a mask or alpha get no depth. Masked pixels, here or in source views, do not influence others; transparent pixels
    do: they show the background and mark the object's outline.
    """

    name: Literal["cpu", "webgpu"]

    def memory_needed(self, extent: SweepExtent) -> MemoryNeed:
        """What sweeps of at most this extent would take.

        Raises:
            PocketGSError: the device's memory does not hold it.
        """

    def reserve(self, extent: SweepExtent) -> None:
        """Take that memory, where it is not taken sweep by sweep.

        Raises:
            PocketGSError: the device's memory does not hold it.
        """

    def release(self) -> None:
        """Give the device's memory back."""

    def sweep(
        self, keyframe: Frame, source_views: Sequence[Frame], search: DepthRange, settings: SweepSettings
    ) -> DepthMap:
        """Compute the depth map of a keyframe.

        Args:
            keyframe: the reference view.
            source_views: if empty, no depth is known.
            search: the depths to test.
            settings: of the sweep.
        """


def create_sweeper(device: Literal["cpu", "webgpu"] = "cpu", gpu: str | None = None, max_memory: int = 3000) -> Sweeper:
    """Make a sweeper.

    Args:
        device: where it computes.
        gpu: part of the name of the GPU to use, or None for the best.
        max_memory: megabytes of GPU memory that it may take.

    Raises:
        PocketGSError: there is no such device.
    """
    if device == "webgpu":
        from pocketgs.prior.webgpu.sweeper import WebGpuSweeper

        return WebGpuSweeper(gpu, max_memory)
    from pocketgs.prior.cpu.sweeper import CpuSweeper

    return CpuSweeper()


def with_room(sweeper: Sweeper, extent: SweepExtent) -> tuple[Sweeper, tuple[str, ...]]:
    """The sweeper with its memory reserved, or the CPU's where the device has too little memory; and warnings.

    Args:
        sweeper: to use.
        extent: the largest sweep.
    """
    try:
        sweeper.reserve(extent)
    except PocketGSError as error:
        sweeper.release()
        return create_sweeper(), (f"depth is computed on the CPU: {error}",)
    return sweeper, ()


def need_of(sweeper: Sweeper, extent: SweepExtent) -> MemoryNeed:
    """What sweeps take, on the CPU where the sweeper's device has too little memory: see `with_room`."""
    try:
        return sweeper.memory_needed(extent)
    except PocketGSError:
        return create_sweeper().memory_needed(extent)


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
