"""What computes the stages of the prior."""

from __future__ import annotations

from dataclasses import dataclass

from pocketgs.prior.bundle.cpu.equations import CpuLinearizer
from pocketgs.prior.bundle.equations import Linearizer
from pocketgs.prior.cloud.cpu.merger import CpuMerger
from pocketgs.prior.cloud.merge import Merger
from pocketgs.prior.depth.cpu.stereo import CpuStereo
from pocketgs.prior.depth.stereo import Stereo
from pocketgs.prior.features.cpu.finder import CpuFinder
from pocketgs.prior.features.finder import FeatureFinder
from pocketgs.system.device import DeviceName


@dataclass(frozen=True)
class Devices:
    """What computes the stages of the prior.

    Attributes:
        finder: detects and matches features.
        linearizer: makes the normal equations of bundle adjustment.
        stereo: computes depth maps and compares them.
        merger: brings their pixels together to points.
    """

    finder: FeatureFinder
    linearizer: Linearizer
    stereo: Stereo
    merger: Merger


def create_devices(device: DeviceName = "cpu", gpu: str | None = None, max_memory: int = 3000) -> Devices:
    """Choose one device for all stages.

    Args:
        device: where it computes.
        gpu: part of the name of the GPU to use, or None for the best.
        max_memory: megabytes of GPU memory that a stage may take.

    Raises:
        PocketGSError: there is no such device, or it lacks something.
    """
    if device == "cpu":
        return Devices(CpuFinder(), CpuLinearizer(), CpuStereo(), CpuMerger())
    # The package works without a graphics library: it is loaded where a GPU is asked for.
    from pocketgs.prior.bundle.webgpu.equations import WebGpuLinearizer
    from pocketgs.prior.cloud.webgpu.merger import WebGpuMerger
    from pocketgs.prior.depth.webgpu.stereo import WebGpuStereo
    from pocketgs.prior.features.webgpu.finder import WebGpuFinder

    chosen = (gpu, max_memory)
    return Devices(WebGpuFinder(*chosen), WebGpuLinearizer(*chosen), WebGpuStereo(*chosen), WebGpuMerger(*chosen))
