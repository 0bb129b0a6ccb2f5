"""The plane sweep on a GPU."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.errors import PocketGSError
from pocketgs.gpu.adapters import DRIVER_BYTES, choose_adapter
from pocketgs.gpu.device import shared_device
from pocketgs.gpu.executor import Executor
from pocketgs.gpu.sizes import Symbols
from pocketgs.prior.depth_range import MOST, DepthRange
from pocketgs.prior.sweep import DepthMap, SweepExtent, SweepSettings, no_depth, step_of
from pocketgs.prior.webgpu.inputs import SweepInputs
from pocketgs.prior.webgpu.layout import MOST_BANDS, MOST_HYPOTHESES
from pocketgs.prior.webgpu.passes import SWEEP, describe
from pocketgs.system.memory_need import MemoryNeed

PIXEL_BYTES, SOURCE_BYTES = 40, 8
"""Bytes of this process per pixel: copies of the view and the result; and per pixel of a source view."""

MAX_PATHS = 8


@dataclass(frozen=True)
class _Plan:
    """Into how many bands of rows a volume is divided, and the bytes of every buffer."""

    bands: int
    sizes: Mapping[str, int]


class WebGpuSweeper:
    """See `pocketgs.prior.sweep.Sweeper`.

    The volume of costs lies in one buffer, or in bands of rows where one would be larger than the device allows. The
    result is the same.

    Args:
        gpu: part of the name of the GPU to use, or None for the best.
        max_memory: megabytes of GPU memory that it may take.

    Raises:
        PocketGSError: there is no such device, or it lacks something.
    """

    name: Literal["cpu", "webgpu"] = "webgpu"

    def __init__(self, gpu: str | None = None, max_memory: int = 3000) -> None:
        adapter = choose_adapter(gpu)
        self.executor = Executor(shared_device(adapter), describe())
        self._largest, self._total = adapter.largest_buffer, max_memory * 1_000_000
        self._shares_memory = adapter.shares_memory
        self._bands = 1

    def memory_needed(self, extent: SweepExtent) -> MemoryNeed:
        """Of the GPU's memory, and of this process's, which holds the same where they share one."""
        device = sum(self._plan(_symbols_of(extent)).sizes.values())
        process = DRIVER_BYTES + extent.pixels * (PIXEL_BYTES + SOURCE_BYTES * extent.source_views)
        return MemoryNeed(process + (device if self._shares_memory else 0), device)

    def reserve(self, extent: SweepExtent) -> None:
        """Make buffers for sweeps of at most this extent."""
        self._make_room(_symbols_of(extent))

    def release(self) -> None:
        """Give up all buffers."""
        self.executor.release()

    def sweep(
        self, keyframe: Frame, source_views: Sequence[Frame], search: DepthRange, settings: SweepSettings
    ) -> DepthMap:
        """Compute the depth map of a keyframe.

        Raises:
            PocketGSError: memory does not hold what it takes, or there are more hypotheses than threads for them.
        """
        if not source_views:
            return no_depth(keyframe, search)
        if search.hypotheses > MOST_HYPOTHESES:
            raise PocketGSError(f"hypotheses: found {search.hypotheses}, expected at most {MOST_HYPOTHESES}")
        inputs = SweepInputs.of(keyframe, source_views, search, settings)
        self._make_room(inputs.given)
        symbols = self.executor.description.symbols({**inputs.given, "bands": self._bands})
        for name, content in inputs.buffers.items():
            self.executor.write(name, content)
        self.executor.write_uniform("sweep", inputs.uniform(symbols))
        self.executor.submit(SWEEP, symbols)
        shape = keyframe.image.shape[:2]
        depth, margin = (
            self.executor.read(name, np.float32, symbols["pixels"]).reshape(shape) for name in ("depths", "margins")
        )
        return DepthMap(depth, margin, step_of(search.inverse_depths))

    def _make_room(self, given: Symbols) -> None:
        """Let every buffer be large enough, and keep those that are."""
        plan, present = self._plan(given, self._bands), self.executor.sizes()
        self.executor.reserve({name: size for name, size in plan.sizes.items() if size > present.get(name, 0)})
        self._bands = plan.bands

    def _plan(self, given: Symbols, least: int = 1) -> _Plan:
        """As few bands as the device allows, but at least so many.

        Raises:
            PocketGSError: not even the most bands are enough.
        """
        description = self.executor.description
        for bands in range(least, MOST_BANDS + 1):
            symbols = description.symbols({**given, "bands": bands})
            sizes = description.sizes(symbols, description.buffers_of([SWEEP]))
            if max(sizes.values()) <= self._largest:
                break
        else:
            name = max(sizes, key=lambda buffer: sizes[buffer])
            raise PocketGSError(
                f"the GPU's buffer {name!r} would take {sizes[name] / 1e6:.0f} MB, the device allows "
                f"{self._largest / 1e6:.0f} MB: expected smaller images (--downscale)"
            )
        if sum(sizes.values()) > self._total:
            raise PocketGSError(
                f"a sweep would take {sum(sizes.values()) / 1e6:.0f} MB of GPU memory, the limit is "
                f"{self._total / 1e6:.0f} MB: expected a larger --max-memory or smaller images (--downscale)"
            )
        return _Plan(bands, sizes)


def _symbols_of(extent: SweepExtent) -> dict[str, int]:
    """The numbers of the largest sweep."""
    return {
        "width": extent.width,
        "height": extent.height,
        "image_width": extent.width,
        "image_height": extent.height,
        "images": 1 + extent.source_views,
        "hypotheses": MOST,
        "paths": MAX_PATHS,
    }
