"""What computes the stages of the prior."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pocketgs.prior.bundle.equations import Adjuster, create_adjuster
from pocketgs.prior.cloud.merge import Merger, create_merger
from pocketgs.prior.depth.stereo import Stereo, create_stereo
from pocketgs.prior.features.finder import FeatureFinder, create_finder


@dataclass(frozen=True)
class Devices:
    """What computes the stages of the prior.

    Attributes:
        finder: detects and matches features.
        adjuster: makes the normal equations of bundle adjustment.
        stereo: computes depth maps and compares them.
        merger: brings their pixels together to points.
    """

    finder: FeatureFinder
    adjuster: Adjuster
    stereo: Stereo
    merger: Merger


def create_devices(device: Literal["cpu", "webgpu"] = "cpu", gpu: str | None = None, max_memory: int = 3000) -> Devices:
    """Choose one device for all stages.

    Args:
        device: where it computes.
        gpu: part of the name of the GPU to use, or None for the best.
        max_memory: megabytes of GPU memory that a stage may take.

    Raises:
        PocketGSError: there is no such device.
    """
    chosen = (device, gpu, max_memory)
    return Devices(create_finder(*chosen), create_adjuster(*chosen), create_stereo(*chosen), create_merger(*chosen))
