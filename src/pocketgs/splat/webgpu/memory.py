"""What a run will take of the GPU's memory, worked out before any of it is taken."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from pocketgs.errors import PocketGSError
from pocketgs.splat.webgpu.description import LEAST_BUFFER, Description
from pocketgs.splat.webgpu.photographs import PIXEL_BYTES, Shelf

DEEPEST_REPLAY = 24
"""Contributions of each pixel that a replay cache has room for, memory permitting; those after them are recomputed."""


@dataclass(frozen=True)
class Limits:
    """What may be allocated, in bytes: `total` by the user's wish, `buffer` by what the device allows a single one."""

    total: int
    buffer: int


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


def plan_memory(
    description: Description,
    sequences: Iterable[str],
    symbols: Mapping[str, int],
    image_sizes: Iterable[tuple[int, int]],
    photographs: Sequence[int],
    limits: Limits,
) -> MemoryPlan:
    """Fit a run into memory: a replay cache as deep as there is room for, and as many photographs as then fit.

    Args:
        description: says how large each buffer is.
        sequences: those that will be run.
        symbols: gaussians, coefficients and entries.
        image_sizes: width and height of every image that will be drawn.
        photographs: pixels of every photograph.
        limits: how much there is.

    Raises:
        PocketGSError: not even without a cache, and with one photograph at a time.
    """
    buffers = [name for name in description.buffers_of(sequences) if name != "photographs"]
    least_shelf = PIXEL_BYTES * max(photographs, default=0)
    for depth in range(DEEPEST_REPLAY, -1, -1):
        sizes = _sizes(description, buffers, {**symbols, "replay_depth": depth}, image_sizes)
        total = sum(sizes.values()) + least_shelf
        if total <= limits.total and sizes.get("replay_cache", 0) <= limits.buffer:
            break
    else:
        raise PocketGSError(
            f"this would take {total / 1e6:.0f} MB of GPU memory, the limit is {limits.total / 1e6:.0f} MB: "
            "expected a larger --max-memory, fewer --max-gaussians or smaller images (--downscale)"
        )
    for name, size in {**sizes, "photographs": least_shelf}.items():
        if size > limits.buffer:
            raise PocketGSError(
                f"the GPU's buffer {name!r} would take {size / 1e6:.0f} MB, the device allows "
                f"{limits.buffer / 1e6:.0f} MB: expected fewer --max-gaussians or smaller images (--downscale)"
            )
    room = min(limits.total - sum(sizes.values()), limits.buffer)
    shelf = Shelf(photographs, room // PIXEL_BYTES)
    return MemoryPlan({**sizes, "photographs": max(PIXEL_BYTES * shelf.pixels, LEAST_BUFFER)}, depth, shelf)


def _sizes(
    description: Description,
    buffers: Sequence[str],
    symbols: Mapping[str, int],
    image_sizes: Iterable[tuple[int, int]],
) -> dict[str, int]:
    """Bytes of every buffer, enough for each of the images."""
    largest = dict.fromkeys(buffers, LEAST_BUFFER)
    for width, height in image_sizes:
        given = {**symbols, "width": width, "height": height}
        sizes = description.sizes(description.symbols(given), buffers)
        largest = {name: max(size, largest[name]) for name, size in sizes.items()}
    return largest
