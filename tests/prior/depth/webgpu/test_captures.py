"""Depth maps of whole captures: the GPU's agree with the CPU's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pocketgs.capture import Capture, open_capture
from pocketgs.capture.synthetic import demo_capture
from pocketgs.prior.depth.depth_maps import depth_maps
from pocketgs.prior.depth.sweep import SweepSettings
from pocketgs.prior.devices import create_devices
from pocketgs.prior.scale import estimate_scale
from pocketgs.training.options import TrainingOptions
from pocketgs.training.preparation import prepare

pytestmark = pytest.mark.usefixtures("adapter")


def assert_same_depths(capture: Capture, keyframes: list[int]) -> None:
    """Over 99 % of the pixels have a depth on both or on neither, and over 99 % of depths are within 0.1 steps."""
    frames = capture.train
    chosen, points = [frames[index] for index in keyframes], [np.zeros((0, 3)) for _ in keyframes]
    distance = estimate_scale(capture).distance
    gpu, cpu = (
        depth_maps(chosen, frames, points, distance, SweepSettings(), create_devices(device).stereo)[1]
        for device in ("webgpu", "cpu")
    )
    for found, expected in zip(gpu, cpu, strict=True):
        same = (found.depth > 0) == (expected.depth > 0)
        both = (found.depth > 0) & (expected.depth > 0)
        steps = np.abs(1 / found.depth[both] - 1 / expected.depth[both]) / expected.step
        assert np.mean(both) > 0.5
        assert np.mean(same) > 0.99
        assert np.mean(steps < 0.1) > 0.99


def test_fern(data_folder: Path) -> None:
    assert_same_depths(open_capture(data_folder / "fern", images="images_8", downscale=4), [0, 8])


def test_the_demos_room() -> None:
    assert_same_depths(demo_capture(96, 72, 12), [2, 6])


def test_a_prior_of_the_webgpu_engine(small_textured: Capture) -> None:
    """Chosen by the engine, swept on the GPU, and as good as the CPU's."""
    gpu, cpu = (
        prepare(small_textured, TrainingOptions(engine=engine, max_gaussians=2000, max_keyframes=4))
        for engine in ("webgpu", "cpu")
    )
    assert gpu.report is not None
    assert cpu.report is not None
    assert (gpu.report.swept_on, cpu.report.swept_on) == ("webgpu", "cpu")
    assert gpu.points is not None
    assert cpu.points is not None
    assert abs(len(gpu.points) - len(cpu.points)) < 0.02 * len(cpu.points)
    assert gpu.report.coverage_known == pytest.approx(cpu.report.coverage_known, abs=0.01)


@pytest.fixture(scope="module")
def small_textured() -> Capture:
    """So large, and with so many keyframes, that rounding does not decide how much of it is covered."""
    return demo_capture(128, 96, 10)
