"""Depth on the CPU where a GPU has too little memory."""

from __future__ import annotations

from pocketgs.errors import PocketGSError
from pocketgs.prior.depth.cpu.stereo import CpuStereo
from pocketgs.prior.depth.stereo import Stereo, StereoExtent, StereoNeed


def with_room(stereo: Stereo, extent: StereoExtent) -> tuple[Stereo, tuple[str, ...]]:
    """The device with its memory reserved, or the CPU where it has too little memory; and warnings.

    Args:
        stereo: the device.
        extent: the most that will be asked for.
    """
    try:
        stereo.reserve(extent)
    except PocketGSError as error:
        stereo.release()
        return CpuStereo(), (f"depth is computed on the CPU: {error}",)
    return stereo, ()


def need_of(stereo: Stereo, extent: StereoExtent) -> StereoNeed:
    """The memory that work takes, on the CPU where the device has too little: see `with_room`."""
    try:
        return stereo.memory_needed(extent)
    except PocketGSError:
        return CpuStereo().memory_needed(extent)
