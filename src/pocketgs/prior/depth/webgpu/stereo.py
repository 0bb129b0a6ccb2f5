"""Stereo on a GPU."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.errors import PocketGSError
from pocketgs.gpu.adapters import DRIVER_BYTES, choose_adapter
from pocketgs.gpu.buffer_sizes import check_buffers
from pocketgs.gpu.description import Description
from pocketgs.gpu.device import shared_device
from pocketgs.gpu.executor import Executor
from pocketgs.gpu.sizes import Symbols
from pocketgs.prior.depth.consistency import ConfidenceMap, SweptViews
from pocketgs.prior.depth.depth_range import MOST, DepthRange
from pocketgs.prior.depth.stereo import MAP_BYTES, StereoExtent, StereoNeed
from pocketgs.prior.depth.sweep import DepthMap, SweepSettings, no_depth, step_of
from pocketgs.prior.depth.webgpu.comparison_inputs import comparison_fields, comparison_numbers, other_records
from pocketgs.prior.depth.webgpu.layout import MOST_BANDS, MOST_HYPOTHESES
from pocketgs.prior.depth.webgpu.passes import COMPARE, SWEEP, describe_comparison, describe_sweep
from pocketgs.prior.depth.webgpu.sweep_inputs import SweepInputs
from pocketgs.system.device import MB, DeviceName, MemoryNeed

PIXEL_BYTES, IMAGE_BYTES = 40, 8
"""Bytes of this process per pixel: copies of the view and the result; and per pixel of each packed image, which is
there twice while it is written to the GPU."""

MAX_PATHS = 8


@dataclass(frozen=True)
class _Plan:
    """Into how many bands of rows a volume is divided, and the bytes of every buffer."""

    bands: int
    sizes: Mapping[str, int]


class WebGpuStereo:
    """See `pocketgs.prior.depth.stereo.Stereo`.

    The volume of costs lies in one buffer, or in bands of rows where one would be larger than the device allows. The
    result is the same.

    Args:
        gpu: part of the name of the GPU to use, or None for the best.
        max_memory: megabytes of GPU memory that it may take.

    Raises:
        PocketGSError: there is no such device, or it lacks something.
    """

    name: DeviceName = "webgpu"

    def __init__(self, gpu: str | None = None, max_memory: int = 3000) -> None:
        adapter = choose_adapter(gpu)
        device = shared_device(adapter)
        self.sweeping, self.comparing = Executor(device, describe_sweep()), Executor(device, describe_comparison())
        self._largest, self._total = adapter.largest_buffer, max_memory * MB
        self._shares_memory = adapter.shares_memory
        self._bands = 1

    def memory_needed(self, extent: StereoExtent) -> StereoNeed:
        """Of the GPU's memory, and of this process's, which holds the same where they share one."""
        sweeping = sum(self._plan_sweep(_numbers_of(extent)).sizes.values())
        comparing = sum(self._sizes(self.comparing.description, _numbers_of(extent)).values())
        images = IMAGE_BYTES * (1 + extent.source_views) * extent.padded_pixels
        maps = 2 * MAP_BYTES * extent.keyframes * extent.padded_pixels  # twice while they are written to the GPU
        return StereoNeed(
            self._need(sweeping, PIXEL_BYTES * extent.pixels + images),
            self._need(comparing, maps),
        )

    def reserve(self, extent: StereoExtent) -> None:
        """Make buffers for sweeps of at most this extent."""
        self.memory_needed(extent)
        self._make_room_to_sweep(_numbers_of(extent))

    def release(self) -> None:
        """Give up all buffers."""
        self.sweeping.release()
        self.comparing.release()

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
        inputs, executor = SweepInputs.of(keyframe, source_views, search, settings), self.sweeping
        self._make_room_to_sweep(inputs.given)
        symbols = executor.description.symbols({**inputs.given, "bands": self._bands})
        for name, content in inputs.buffers.items():
            executor.write(name, content)
        executor.write_uniform("sweep", inputs.uniform(symbols))
        executor.submit_by_pass(SWEEP, symbols)
        shape = keyframe.image.shape[:2]
        depth, margin = (
            executor.read(name, np.float32, symbols["pixels"]).reshape(shape) for name in ("depths", "margins")
        )
        return DepthMap(depth, margin, step_of(search.inverse_depths))

    def compare(
        self, views: SweptViews, margins: Sequence[np.ndarray], tolerance: float, least: float
    ) -> Iterator[ConfidenceMap]:
        """Compare the depths of each view with the other views' depths.

        Raises:
            PocketGSError: memory does not hold the depth maps.
        """
        self.sweeping.release()
        executor, description = self.comparing, self.comparing.description
        numbers = [comparison_numbers(views, view) for view in range(len(views.depths))]
        largest = max(numbers, key=lambda given: given["width"] * given["height"])
        executor.reserve(self._sizes(description, largest))
        executor.write("maps", views.depths)
        for view, given in enumerate(numbers):
            executor.write("others", other_records(views, view))
            executor.write("margins", np.asarray(margins[view], np.float32))
            executor.write_uniform("comparison", comparison_fields(views, view, given, tolerance, least))
            symbols = description.symbols(given)
            executor.submit(COMPARE, symbols)
            shape = (given["height"], given["width"])
            yield ConfidenceMap(
                executor.read("confidences", np.float32, symbols["pixels"]).reshape(shape),
                executor.read("footprints", np.float32, symbols["pixels"]).reshape(shape),
            )

    def _need(self, device: int, host: int) -> MemoryNeed:
        return MemoryNeed(DRIVER_BYTES + host + (device if self._shares_memory else 0), device)

    def _make_room_to_sweep(self, given: Symbols) -> None:
        """Let every buffer be large enough, and keep those that are."""
        plan = self._plan_sweep(given, self._bands)
        self.sweeping.grow(plan.sizes)
        self._bands = plan.bands

    def _plan_sweep(self, given: Symbols, least: int = 1) -> _Plan:
        """As few bands as the device allows, but at least so many.

        Raises:
            PocketGSError: not even the most bands are enough.
        """
        for bands in range(least, MOST_BANDS):
            try:
                return _Plan(bands, self._sizes(self.sweeping.description, {**given, "bands": bands}))
            except PocketGSError:
                continue
        return _Plan(MOST_BANDS, self._sizes(self.sweeping.description, {**given, "bands": MOST_BANDS}))

    def _sizes(self, description: Description, given: Symbols) -> dict[str, int]:
        """Bytes of all buffers.

        Raises:
            PocketGSError: one is larger than the device allows, or all together than the user does.
        """
        sizes = description.sizes(description.symbols(given), description.buffers)
        expected = "smaller images (--downscale)"
        name = max(sizes, key=lambda buffer: sizes[buffer])
        check_buffers({name: sizes[name]}, self._largest, expected)
        if sum(sizes.values()) > self._total:
            raise PocketGSError(
                f"depth would take {sum(sizes.values()) / 1e6:.0f} MB of GPU memory, the limit is "
                f"{self._total / 1e6:.0f} MB: expected a larger --max-memory or {expected}"
            )
        return sizes


def _numbers_of(extent: StereoExtent) -> dict[str, int]:
    """The numbers of the largest sweep and comparison."""
    return {
        "width": extent.width,
        "height": extent.height,
        "image_width": extent.image_width,
        "image_height": extent.image_height,
        "images": 1 + extent.source_views,
        "hypotheses": MOST,
        "paths": MAX_PATHS,
        "views": extent.keyframes,
    }
