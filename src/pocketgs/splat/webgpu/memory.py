"""The GPU memory that a run needs, computed before any of it is allocated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

from pocketgs.errors import PocketGSError
from pocketgs.gpu.buffer_sizes import check_buffers
from pocketgs.gpu.description import MIN_BUFFER, Description
from pocketgs.splat.webgpu.photographs import PIXEL_BYTES, Shelf

RENDERING = ("render", "render depth")

INTERSECTIONS_PER_GAUSSIAN = 8
MIN_INTERSECTIONS = 1 << 16
"""Room for intersections of tiles' lists to begin with."""

GROWTH = 1.25
"""Room is made for so many times the intersections that there was too little for."""

EXPECTED_PER_GAUSSIAN, EXPECTED_PER_PIXEL = 4.0, 1.5
"""Intersections that a run's tiles' lists may come to hold: large Gaussians tile the image."""

ROW_GROWTH = 1.25
"""Room is made for so many times the Gaussians that there was room for, where there is memory for it: a run that begins
with four fifths of its Gaussians makes room once, and for no more than them."""

MAX_REPLAY_DEPTH = 24
"""Contributions of each pixel that a replay cache has room for, memory permitting; those after them are recomputed."""


@dataclass(frozen=True)
class MemoryLimits:
    """Maximum bytes: `total` of all buffers, as the user asks; `buffer` of each one, as the device allows."""

    total: int
    buffer: int


@dataclass(frozen=True)
class Extent:
    """What the engine is to hold; it determines the sizes of the buffers.

    Attributes:
        gaussians: their number.
        capacity: number of Gaussians that there is room for.
        coefficients: of spherical harmonics per channel.
        intersections: number of intersections that the tiles' lists have room for.
        photographs: width and height of each.
        drawn_sizes: width and height of other images that are drawn.
        trains: whether it is to train, or only to render.
    """

    gaussians: int = 0
    capacity: int = 0
    coefficients: int = 1
    intersections: int = 0
    photographs: tuple[tuple[int, int], ...] = ()
    drawn_sizes: frozenset[tuple[int, int]] = frozenset()
    trains: bool = False

    @property
    def symbols(self) -> dict[str, int]:
        """The numbers that stay the same from image to image."""
        return {
            "gaussians": self.gaussians,
            "capacity": self.capacity,
            "coefficients": self.coefficients,
            "intersections": self.intersections,
            "photographs": len(self.photographs),
        }


@dataclass(frozen=True)
class MemoryPlan:
    """What will be allocated.

    Attributes:
        sizes: bytes by buffer.
        replay_depth: contributions of each pixel that the replay cache has room for.
        shelf: where the photographs lie.
    """

    sizes: Mapping[str, int]
    replay_depth: int
    shelf: Shelf

    @property
    def total(self) -> int:
        """Bytes in all."""
        return sum(self.sizes.values())


def plan_memory(description: Description, extent: Extent, limits: MemoryLimits) -> MemoryPlan:
    """Fit a run into memory: a replay cache as deep as there is room for, and as many photographs as then fit.

    Args:
        description: says how large each buffer is.
        extent: what is to be held.
        limits: how much there is.

    Raises:
        PocketGSError: not even without a cache, and with one photograph at a time.
    """
    photographs = [width * height for width, height in extent.photographs]
    least_shelf = PIXEL_BYTES * max(photographs, default=0)
    for depth in range(MAX_REPLAY_DEPTH, -1, -1):
        sizes = _sizes(description, extent, depth)
        total = sum(sizes.values()) + least_shelf
        if total <= limits.total and sizes.get("replay_cache", 0) <= limits.buffer:
            break
    else:
        raise PocketGSError(
            f"this would take {total / 1e6:.0f} MB of GPU memory, the limit is {limits.total / 1e6:.0f} MB: "
            "expected a larger --max-memory, fewer --max-gaussians or smaller images (--downscale)"
        )
    smaller = "fewer --max-gaussians or smaller images (--downscale)"
    check_buffers({**sizes, "photographs": least_shelf}, limits.buffer, smaller)
    room = min(limits.total - sum(sizes.values()), limits.buffer)
    shelf = Shelf(photographs, room // PIXEL_BYTES)
    return MemoryPlan({**sizes, "photographs": max(PIXEL_BYTES * shelf.pixels, MIN_BUFFER)}, depth, shelf)


def expected_extent(
    gaussians: int, coefficients: int, photographs: Sequence[tuple[int, int]], most_intersections: int
) -> Extent:
    """What a run may come to hold: as many intersections as there are expected to be, of at most so many."""
    largest = max((width * height for width, height in photographs), default=0)
    expected = int(EXPECTED_PER_GAUSSIAN * gaussians + EXPECTED_PER_PIXEL * largest)
    wanted = min(max(expected, INTERSECTIONS_PER_GAUSSIAN * gaussians), most_intersections)
    room = max(MIN_INTERSECTIONS, wanted)
    return Extent(gaussians, gaussians, coefficients, room, tuple(photographs), frozenset(photographs), trains=True)


def plan_rows(
    description: Description, extent: Extent, gaussians: int, limits: MemoryLimits
) -> tuple[Extent, MemoryPlan]:
    """What is to be held, and allocated, once there are so many Gaussians.

    If new room is made at all, there is some for more Gaussians, unless it would displace photographs or the replay
    cache: that would cost time at every step, and making room again costs it only once.

    Raises:
        PocketGSError: it does not fit.
    """
    capacity = extent.capacity
    extent = replace(extent, gaussians=gaussians, capacity=max(gaussians, capacity))
    if gaussians > capacity:
        return _with_headroom(description, extent, max(gaussians, int(ROW_GROWTH * capacity)), limits)
    return extent, plan_memory(description, extent, limits)


def plan_run(description: Description, extent: Extent, limits: MemoryLimits) -> MemoryPlan:
    """The most that a run may come to allocate which holds an extent at last, however it grows to it.

    Raises:
        PocketGSError: it does not fit.
    """
    return _with_headroom(description, extent, int(ROW_GROWTH * extent.gaussians), limits)[1]


def _with_headroom(
    description: Description, extent: Extent, capacity: int, limits: MemoryLimits
) -> tuple[Extent, MemoryPlan]:
    """An extent with room for so many Gaussians, unless that displaces something else, and its plan."""
    plan = plan_memory(description, extent, limits)
    roomy = replace(extent, capacity=capacity)
    with suppress(PocketGSError):
        roomy_plan = plan_memory(description, roomy, limits)
        if (roomy_plan.shelf, roomy_plan.replay_depth) == (plan.shelf, plan.replay_depth):
            return roomy, roomy_plan
    return extent, plan


def _sizes(description: Description, extent: Extent, replay_depth: int) -> dict[str, int]:
    """Bytes of every buffer but that of the photographs, enough for each of the images."""
    training = tuple(description.sequences) if extent.trains else RENDERING
    uses = ((RENDERING, extent.drawn_sizes), (training, {(1, 1), *extent.photographs}))
    largest: dict[str, int] = {}
    for sequences, image_sizes in uses:
        buffers = [name for name in description.buffers_of(sequences) if name != "photographs"]
        for width, height in image_sizes:
            given = {**extent.symbols, "replay_depth": replay_depth, "width": width, "height": height}
            for name, size in description.sizes(description.symbols(given), buffers).items():
                largest[name] = max(size, largest.get(name, 0))
    return largest
