"""Choosing the device that finds neighbours."""

from __future__ import annotations

from pocketgs.seeding.cpu import CpuSearch
from pocketgs.seeding.neighbourhoods import NeighbourSearch
from pocketgs.system.device import DeviceName


def create_search(device: DeviceName = "cpu", gpu: str | None = None, max_memory: int = 3000) -> NeighbourSearch:
    """Choose the device that finds neighbours.

    Args:
        device: where it computes.
        gpu: part of the name of the GPU to use, or None for the best.
        max_memory: megabytes of GPU memory that it may take.

    Raises:
        PocketGSError: there is no such device.
    """
    if device == "cpu":
        return CpuSearch()
    # The package works without a graphics library: it is loaded where a GPU is asked for.
    from pocketgs.seeding.webgpu.search import WebGpuSearch

    return WebGpuSearch(gpu, max_memory)


def with_room(search: NeighbourSearch, points: int) -> tuple[NeighbourSearch, tuple[str, ...]]:
    """The device, or the CPU where its memory does not hold so many points; and warnings."""
    if points <= search.most_points:
        return search, ()
    found = f"{points:,} points, of which the GPU's memory holds {search.most_points:,}"
    return CpuSearch(), (f"neighbours are found on the CPU: {found}",)
