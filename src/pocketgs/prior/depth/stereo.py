"""Computing and comparing depth maps: the interface that the CPU and GPU versions implement."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.prior.depth.consistency import ConfidenceMap, SweptViews
from pocketgs.prior.depth.depth_range import DepthRange
from pocketgs.prior.depth.sweep import DepthMap, SweepSettings
from pocketgs.system.device import DeviceName, MemoryNeed

MAP_BYTES = 4
"""Bytes per pixel of a depth map, padded, while all are compared."""


@dataclass(frozen=True)
class StereoExtent:
    """Maximum sizes in a run; memory is computed from them.

    Attributes:
        width, height: of the largest frame at the size of a sweep, in pixels.
        image_width, image_height: the largest width and height of any frame; the frames may differ.
        source_views: number of source views per keyframe.
        keyframes: their number.
    """

    width: int
    height: int
    image_width: int
    image_height: int
    source_views: int
    keyframes: int

    @staticmethod
    def of(sizes: Sequence[tuple[int, int]], source_views: int, keyframes: int) -> StereoExtent:
        """The maximum sizes for frames of these widths and heights."""
        largest = max(sizes, key=lambda size: size[0] * size[1])
        widths, heights = zip(*sizes, strict=True)
        return StereoExtent(*largest, max(widths), max(heights), source_views, keyframes)

    @property
    def pixels(self) -> int:
        """Pixels of the largest frame."""
        return self.width * self.height

    @property
    def padded_pixels(self) -> int:
        """Pixels of each frame when all are padded to one size."""
        return self.image_width * self.image_height


class StereoNeed(NamedTuple):
    """The memory that depth takes: while keyframes are swept, and then while their depth maps are compared."""

    sweeping: MemoryNeed
    comparing: MemoryNeed

    @property
    def on_gpu(self) -> bool:
        """Whether a GPU sweeps: the CPU takes no device's memory."""
        return self.sweeping.device > 0


class Stereo(Protocol):
    """Computes depth maps of keyframes and compares them, on one device.

    All devices have the same steps: census costs, semi-global matching, winners, a bilateral filter. Pixels excluded
    by a mask or alpha get no depth. Masked pixels, here or in source views, do not influence others; transparent pixels
    do: they show the background and mark the object's outline.
    """

    name: DeviceName

    def memory_needed(self, extent: StereoExtent) -> StereoNeed:
        """The memory that work of at most this extent takes.

        Raises:
            PocketGSError: the device's memory does not hold it.
        """

    def reserve(self, extent: StereoExtent) -> None:
        """Take the memory of sweeps, where it is not taken sweep by sweep.

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

    def compare(
        self, views: SweptViews, margins: Sequence[np.ndarray], tolerance: float, least: float
    ) -> Iterator[ConfidenceMap]:
        """Compare every depth of each view, one view after the other, with the other views' depths.

        Depths agree within the tolerance, or within half a step of the coarser of the two sweeps, the maximum distance
        of a surface from the nearest hypothesis; within a whole step where they cannot be told from infinity.

        Args:
            views: all views.
            margins: of each view, (H, W) share by which its depths are cheaper than the next best.
            tolerance: maximum relative difference of agreeing depths.
            least: minimum confidence outside holes.
        """
