"""Memory of sweeps on the GPU: bands of rows, what is reserved and released, and the CPU in place of a full GPU."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pocketgs.capture.capture import Frame
from pocketgs.capture.synthetic import true_capture
from pocketgs.errors import PocketGSError
from pocketgs.gpu.description import MIN_BUFFER
from pocketgs.prior.cpu.sweeper import CpuSweeper
from pocketgs.prior.depth_maps import depth_maps
from pocketgs.prior.depth_range import DepthRange
from pocketgs.prior.sweep import SweepExtent, SweepSettings, create_sweeper, need_of, with_room
from pocketgs.prior.webgpu.layout import MOST_BANDS
from pocketgs.prior.webgpu.sweeper import WebGpuSweeper
from pocketgs.training.options import SizedOptions, TrainingOptions
from pocketgs.training.preparation import sweeper_of

pytestmark = pytest.mark.usefixtures("adapter")

SETTINGS = SweepSettings()


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    return true_capture(40, 34, frames=4, points=10).train


def limited(largest: int) -> WebGpuSweeper:
    """A sweeper on a device that allows buffers of so many bytes."""
    sweeper = WebGpuSweeper()
    sweeper._largest = largest
    return sweeper


def bands_of(sweeper: WebGpuSweeper) -> int:
    return sum(name.startswith("totals") and size > MIN_BUFFER for name, size in sweeper.executor.sizes().items())


def test_bands_of_rows_change_nothing(frames: list[Frame]) -> None:
    """34 rows are not a multiple of 3 or 4: the last band has fewer."""
    search, sweeper = DepthRange(1.0, np.inf, 41), WebGpuSweeper()
    expected = sweeper.sweep(frames[0], frames[1:], search, SETTINGS)
    assert bands_of(sweeper) == 1
    for bands in (2, 3, 4):
        sweeper.release()
        largest = 2 * 48 * 40 * -(-34 // bands)
        sweeper._largest = largest
        for _ in range(2):
            found = sweeper.sweep(frames[0], frames[1:], search, SETTINGS)
            np.testing.assert_array_equal(found.depth, expected.depth)
            np.testing.assert_array_equal(found.margin, expected.margin)
        assert bands_of(sweeper) == bands
        assert max(sweeper.executor.sizes().values()) == largest


def test_no_buffer_is_larger_than_the_binding_that_every_device_allows() -> None:
    """Of the largest sweeps."""
    for width, height in ((730, 547), (547, 730), (632, 632)):
        sweeper = limited(128 << 20)
        sweeper.reserve(SweepExtent(width, height, 4))
        assert max(sweeper.executor.sizes().values()) <= 128 << 20
        assert sum(sweeper.executor.sizes().values()) < 260_000_000
        assert bands_of(sweeper) == 2
        sweeper.release()


def test_what_is_reserved_is_what_was_planned_and_is_released(frames: list[Frame]) -> None:
    sweeper, extent = WebGpuSweeper(), SweepExtent(40, 34, 3)
    needed = sweeper.memory_needed(extent)
    uniforms = sum(sweeper.executor.sizes().values())
    sweeper.reserve(extent)
    assert sum(sweeper.executor.sizes().values()) == needed.device + uniforms
    assert needed.process >= needed.device
    before = sweeper.executor.sizes()
    sweeper.sweep(frames[0], frames[1:], DepthRange(1.0, 5.0, 192), SETTINGS)
    assert sweeper.executor.sizes() == before
    sweeper.release()
    assert sum(sweeper.executor.sizes().values()) == uniforms
    # It can be used again.
    assert sweeper.sweep(frames[0], frames[1:], DepthRange(1.0, 5.0, 48), SETTINGS).depth.any()


def test_larger_images_than_reserved_get_their_room(frames: list[Frame]) -> None:
    sweeper = WebGpuSweeper()
    sweeper.reserve(SweepExtent(10, 10, 1))
    search = DepthRange(1.0, 5.0, 50)
    found = sweeper.sweep(frames[0], frames[1:], search, SETTINGS)
    np.testing.assert_array_equal(found.depth, WebGpuSweeper().sweep(frames[0], frames[1:], search, SETTINGS).depth)


def test_too_little_memory_is_refused_before_any_is_taken(frames: list[Frame]) -> None:
    extent = SweepExtent(40, 34, 3)
    too_small = limited(2 * 192 * 40 * 34 // MOST_BANDS - 1)
    with pytest.raises(PocketGSError, match=r"the GPU's buffer 'totals_\d' would take"):
        too_small.reserve(extent)
    bounded = WebGpuSweeper(max_memory=1)
    with pytest.raises(PocketGSError, match="a sweep would take 25 MB of GPU memory, the limit is 1 MB"):
        bounded.memory_needed(replace(extent, width=200, height=200))
    for sweeper in (too_small, bounded):
        assert bands_of(sweeper) == 0


def test_the_cpu_takes_the_place_of_a_gpu_with_too_little_memory(frames: list[Frame]) -> None:
    bounded, extent = WebGpuSweeper(max_memory=1), SweepExtent(200, 200, 3)
    assert need_of(bounded, extent) == CpuSweeper().memory_needed(extent)
    assert need_of(bounded, extent).device == 0
    used, warnings = with_room(bounded, extent)
    assert used.name == "cpu"
    (warning,) = warnings
    assert warning.startswith("depth is computed on the CPU: a sweep would take")
    points = [np.zeros((0, 3))]
    sweeper = limited(1000)
    swept = depth_maps(frames[:1], frames, points, 3.0, SETTINGS, sweeper)
    assert (swept.device, len(swept.warnings)) == ("cpu", 1)
    expected = depth_maps(frames[:1], frames, points, 3.0, SETTINGS, create_sweeper())
    np.testing.assert_array_equal(swept.maps[0].depth, expected.maps[0].depth)
    assert expected.warnings == ()


def test_more_hypotheses_than_threads_are_refused(frames: list[Frame]) -> None:
    with pytest.raises(PocketGSError, match="hypotheses: found 513, expected at most 512"):
        WebGpuSweeper().sweep(frames[0], frames[1:], DepthRange(1.0, 5.0, 513), SETTINGS)


def test_the_engine_chooses_the_sweeper() -> None:
    assert sweeper_of(TrainingOptions(engine="cpu")).name == "cpu"
    assert sweeper_of(SizedOptions(engine="webgpu")).name == "webgpu"
    with pytest.raises(PocketGSError, match="expected one named like 'none of that name'"):
        sweeper_of(TrainingOptions(engine="webgpu", gpu="none of that name"))
