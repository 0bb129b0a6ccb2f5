"""Memory of sweeps on the GPU: bands of rows, what is reserved and released, and the CPU in place of a full GPU."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from pocketgs.capture.capture import Frame
from pocketgs.capture.synthetic import true_capture
from pocketgs.errors import PocketGSError
from pocketgs.gpu.description import MIN_BUFFER
from pocketgs.prior.depth.consistency import ConfidenceMap
from pocketgs.prior.depth.cpu.stereo import CpuStereo
from pocketgs.prior.depth.depth_maps import stereo_extent
from pocketgs.prior.depth.depth_range import DepthRange
from pocketgs.prior.depth.room import need_of, with_room
from pocketgs.prior.depth.stereo import Stereo, StereoExtent
from pocketgs.prior.depth.sweep import SweepSettings
from pocketgs.prior.depth.webgpu.layout import MOST_BANDS
from pocketgs.prior.depth.webgpu.stereo import WebGpuStereo, _numbers_of
from pocketgs.prior.devices import Devices, create_devices
from pocketgs.prior.prior import build_prior
from pocketgs.training.options import SizedOptions, TrainingOptions
from pocketgs.training.preparation import devices_of

pytestmark = pytest.mark.usefixtures("adapter")

SETTINGS = SweepSettings()


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    return true_capture(40, 34, frames=4, points=10).train


def limited(largest: int) -> WebGpuStereo:
    """On a device that allows buffers of so many bytes."""
    stereo = WebGpuStereo()
    stereo._largest = largest
    return stereo


def bands_of(stereo: WebGpuStereo) -> int:
    return sum(name.startswith("totals") and size > MIN_BUFFER for name, size in stereo.sweeping.sizes().items())


def sweeping_on(stereo: Stereo) -> Devices:
    """The CPU, but for depth."""
    return replace(create_devices(), stereo=stereo)


def test_bands_of_rows_change_nothing(frames: list[Frame]) -> None:
    """34 rows are not a multiple of 3 or 4: the last band has fewer."""
    search, stereo = DepthRange(1.0, np.inf, 41), WebGpuStereo()
    expected = stereo.sweep(frames[0], frames[1:], search, SETTINGS)
    assert bands_of(stereo) == 1
    for bands in (2, 3, 4):
        stereo.release()
        largest = 2 * 48 * 40 * -(-34 // bands)
        stereo._largest = largest
        for _ in range(2):
            found = stereo.sweep(frames[0], frames[1:], search, SETTINGS)
            np.testing.assert_array_equal(found.depth, expected.depth)
            np.testing.assert_array_equal(found.margin, expected.margin)
        assert bands_of(stereo) == bands
        assert max(stereo.sweeping.sizes().values()) == largest


def test_no_buffer_is_larger_than_the_binding_that_every_device_allows() -> None:
    """Of the largest sweeps."""
    for width, height in ((730, 547), (547, 730), (632, 632)):
        stereo = limited(128 << 20)
        stereo.reserve(StereoExtent.of([(width, height)], 4, 40))
        assert max(stereo.sweeping.sizes().values()) <= 128 << 20
        assert sum(stereo.sweeping.sizes().values()) < 260_000_000
        assert bands_of(stereo) == 2
        stereo.release()


def test_what_is_reserved_is_what_was_planned_and_is_released(frames: list[Frame]) -> None:
    stereo, extent = WebGpuStereo(), StereoExtent.of([(40, 34)], 3, 4)
    needed = stereo.memory_needed(extent).sweeping
    uniforms = sum(stereo.sweeping.sizes().values())
    stereo.reserve(extent)
    assert sum(stereo.sweeping.sizes().values()) == needed.device + uniforms
    assert needed.process >= needed.device
    before = stereo.sweeping.sizes()
    stereo.sweep(frames[0], frames[1:], DepthRange(1.0, 5.0, 192), SETTINGS)
    assert stereo.sweeping.sizes() == before
    stereo.release()
    assert sum(stereo.sweeping.sizes().values()) == uniforms
    # It can be used again.
    assert stereo.sweep(frames[0], frames[1:], DepthRange(1.0, 5.0, 48), SETTINGS).depth.any()


def test_larger_images_than_reserved_get_their_room(frames: list[Frame]) -> None:
    stereo = WebGpuStereo()
    stereo.reserve(StereoExtent.of([(10, 10)], 1, 2))
    search = DepthRange(1.0, 5.0, 50)
    found = stereo.sweep(frames[0], frames[1:], search, SETTINGS)
    np.testing.assert_array_equal(found.depth, WebGpuStereo().sweep(frames[0], frames[1:], search, SETTINGS).depth)


def test_too_little_memory_is_refused_before_any_is_taken(frames: list[Frame]) -> None:
    extent = StereoExtent.of([(40, 34)], 3, 4)
    too_small = limited(2 * 192 * 40 * 34 // MOST_BANDS - 1)
    with pytest.raises(PocketGSError, match=r"the GPU's buffer 'totals_\d' would take"):
        too_small.reserve(extent)
    bounded = WebGpuStereo(max_memory=1)
    with pytest.raises(PocketGSError, match="depth would take 25 MB of GPU memory, the limit is 1 MB"):
        bounded.memory_needed(StereoExtent.of([(200, 200)], 3, 4))
    for stereo in (too_small, bounded):
        assert bands_of(stereo) == 0


def test_the_cpu_takes_the_place_of_a_gpu_with_too_little_memory(frames: list[Frame]) -> None:
    bounded, extent = WebGpuStereo(max_memory=1), StereoExtent.of([(200, 200)], 3, 4)
    assert need_of(bounded, extent) == CpuStereo().memory_needed(extent)
    assert need_of(bounded, extent).sweeping.device == 0
    used, warnings = with_room(bounded, extent)
    assert used.name == "cpu"
    (warning,) = warnings
    assert warning.startswith("depth is computed on the CPU: depth would take")
    enough = WebGpuStereo()
    assert with_room(enough, extent) == (enough, ())


def test_a_prior_without_room_on_the_gpu_is_the_cpus() -> None:
    capture = true_capture(64, 48, frames=5, points=10)
    found, expected = (
        build_prior(capture, 500, devices=sweeping_on(stereo)) for stereo in (limited(1000), CpuStereo())
    )
    assert found.report is not None
    assert expected.report is not None
    assert found.report.swept_on == "cpu"
    assert len(found.report.warnings) == len(expected.report.warnings) + 1
    assert found.points is not None
    assert expected.points is not None
    np.testing.assert_array_equal(found.points.positions, expected.points.positions)


def test_a_gpu_that_fails_after_its_sweeps_leaves_comparing_to_the_cpu(monkeypatch: pytest.MonkeyPatch) -> None:
    capture, stereo = true_capture(64, 48, frames=5, points=10), WebGpuStereo()
    expected = build_prior(capture, 500, devices=sweeping_on(stereo))

    def fails(*given: object) -> Iterator[ConfidenceMap]:
        raise PocketGSError("the GPU is out of memory")

    monkeypatch.setattr(stereo, "compare", fails)
    found = build_prior(capture, 500, devices=sweeping_on(stereo))
    assert found.report is not None
    assert expected.report is not None
    assert found.report.swept_on == "webgpu"
    assert "depth maps are compared on the CPU: the GPU is out of memory" in found.report.warnings
    assert len(found.report.warnings) == len(expected.report.warnings) + 1
    assert found.report.points == pytest.approx(expected.report.points, rel=0.02)


def test_memory_is_given_back_when_a_sweep_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*given: object) -> None:
        raise KeyboardInterrupt

    stereo = WebGpuStereo()
    uniforms = stereo.sweeping.sizes()
    monkeypatch.setattr(stereo, "sweep", fails)
    with pytest.raises(KeyboardInterrupt):
        build_prior(true_capture(64, 48, frames=5, points=10), 500, devices=sweeping_on(stereo))
    assert stereo.sweeping.sizes() == uniforms


def test_more_hypotheses_than_threads_are_refused(frames: list[Frame]) -> None:
    with pytest.raises(PocketGSError, match="hypotheses: found 513, expected at most 512"):
        WebGpuStereo().sweep(frames[0], frames[1:], DepthRange(1.0, 5.0, 513), SETTINGS)


def test_frames_of_both_orientations_get_their_room() -> None:
    """Images are padded to the widest and the tallest, volumes are not."""
    extent = stereo_extent([(1600, 1200), (1200, 1600), (100, 100)], 10, SETTINGS)
    assert (extent.width, extent.height) == (731, 548)
    assert (extent.image_width, extent.image_height) == (731, 731)
    stereo = WebGpuStereo()
    sizes = stereo._plan_sweep(_numbers_of(extent)).sizes
    assert sizes["photographs"] == 4 * 5 * 731 * 731
    assert sum(size for name, size in sizes.items() if name.startswith("costs")) < 1.01 * 192 * 731 * 548
    assert stereo.memory_needed(extent).comparing.device >= 4 * 10 * 731 * 731
    padded = 731 * 731 - 731 * 548
    one_way = replace(extent, image_height=548)
    for device, images in ((stereo, 8 * 5), (CpuStereo(), 4 * 4)):
        more, less = device.memory_needed(extent), device.memory_needed(one_way)
        assert more.sweeping.process - less.sweeping.process >= images * padded
        assert more.comparing.process - less.comparing.process >= 4 * 10 * padded


def test_the_engine_chooses_the_device() -> None:
    assert devices_of(TrainingOptions(engine="cpu")).stereo.name == "cpu"
    assert devices_of(SizedOptions(engine="webgpu")).stereo.name == "webgpu"
    with pytest.raises(PocketGSError, match="expected one named like 'none of that name'"):
        devices_of(TrainingOptions(engine="webgpu", gpu="none of that name"))
