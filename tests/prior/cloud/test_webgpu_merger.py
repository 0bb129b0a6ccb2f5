"""The GPU's merging against the CPU's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pocketgs.capture import open_capture
from pocketgs.prior import dense_cloud, prior
from pocketgs.prior.cloud.cpu.merger import CpuMerger
from pocketgs.prior.cloud.merge import Candidates
from pocketgs.prior.cloud.webgpu.merger import WebGpuMerger
from pocketgs.prior.devices import create_devices
from pocketgs.scene.point_cloud import PointCloud

pytestmark = pytest.mark.usefixtures("adapter")


@pytest.fixture(scope="module")
def merger() -> WebGpuMerger:
    return WebGpuMerger()


def wave(count: int) -> Candidates:
    """Pixels of a wave, with footprints and details that vary, and some far away."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-1, 1, (2, count))
    positions = np.stack([x, y, 0.2 * np.sin(4 * x) * np.cos(3 * y)], axis=1)
    positions[: count // 50] *= 30
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    footprints = 0.01 * np.exp(rng.normal(0, 0.4, count)) * np.linalg.norm(positions - [0, 0, 2], axis=1)
    colours = np.clip(0.5 + 0.3 * positions, 0, 1).astype(np.float32)
    details = rng.uniform(0, 0.2, count).astype(np.float32)
    return Candidates(positions, colours, directions, footprints, details, rng.uniform(0.1, 1, count))


def assert_alike(found: PointCloud, expected: PointCloud, unit: float) -> None:
    """The same points in another order, but for those of a few voxels."""
    assert abs(len(found) - len(expected)) <= 0.002 * len(expected) + 1
    distance, nearest = cKDTree(expected.positions).query(found.positions)
    same = distance < 1e-5 * unit
    assert np.mean(same) > 0.99
    for name, tolerance in (("colours", 1e-5), ("directions", 2e-4), ("confidences", 1e-5)):
        one, other = getattr(found, name)[same], getattr(expected, name)[nearest[same]]
        assert np.quantile(np.abs(one - other), 0.999) < tolerance, name


@pytest.mark.parametrize("count", [50, 3000, 20_000])
def test_voxels_are_those_of_the_cpu(merger: WebGpuMerger, count: int) -> None:
    candidates = wave(20_000)
    found, expected = merger.merged(candidates, count), CpuMerger().merged(candidates, count)
    assert len(found) <= count
    assert_alike(found, expected, 1.0)


@pytest.mark.parametrize(("unit", "offset"), [(1e-6, 0.0), (1e6, 0.0), (1.0, 1e5)])
def test_neither_the_unit_nor_the_place_matters(merger: WebGpuMerger, unit: float, offset: float) -> None:
    candidates = wave(5000)
    footprints = unit * candidates.footprints
    moved = replace(candidates, positions=unit * candidates.positions + offset, footprints=footprints)
    assert_alike(merger.merged(moved, 1000), CpuMerger().merged(moved, 1000), unit)


def test_same_bits_every_time(merger: WebGpuMerger) -> None:
    first, second = (merger.merged(wave(5000), 1000) for _ in range(2))
    np.testing.assert_array_equal(first.positions, second.positions)
    np.testing.assert_array_equal(first.colours, second.colours)


def test_few_candidates(merger: WebGpuMerger) -> None:
    nothing = wave(100).select(np.zeros(100, bool))
    assert len(merger.merged(nothing, 10)) == 0
    one = wave(100).select(np.arange(100) == 60)
    np.testing.assert_allclose(merger.merged(one, 10).positions, one.positions, rtol=1e-6)
    in_one_place = replace(wave(100), positions=np.ones((100, 3)), footprints=np.ones(100), details=np.ones(100))
    np.testing.assert_allclose(merger.merged(in_one_place, 10).positions, np.ones((1, 3)))


def test_what_the_memory_does_not_hold_is_merged_on_the_cpu() -> None:
    candidates = wave(20_000)
    found, expected = WebGpuMerger(max_memory=1).merged(candidates, 500), CpuMerger().merged(candidates, 500)
    np.testing.assert_array_equal(found.positions, expected.positions)


def remembered(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, which runs once and returns the same from then on."""
    results: list[Any] = []

    def run(*arguments: Any) -> Any:
        if not results:
            results.append(function(*arguments))
        return results[0]

    return run


def test_the_cloud_of_a_real_capture(data_folder: Path, merger: WebGpuMerger, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two priors, which share what comes before merging: poses and confirmed depth."""
    monkeypatch.setattr(prior, "_posed", remembered(prior._posed))
    monkeypatch.setattr(dense_cloud, "_confirmed", remembered(dense_cloud._confirmed))
    capture = open_capture(data_folder / "fern", images="images_8", downscale=4)
    gpu, cpu = (
        prior.build_prior(capture, 4000, devices=replace(create_devices(), merger=one)) for one in (merger, CpuMerger())
    )
    assert gpu.points is not None
    assert cpu.points is not None
    assert gpu.report is not None
    assert cpu.report is not None
    assert len(gpu.points) == pytest.approx(len(cpu.points), rel=0.002)
    distance, _ = cKDTree(cpu.points.positions).query(gpu.points.positions)
    extent = np.ptp(cpu.points.positions, axis=0).max()
    assert np.mean(distance < 1e-5 * extent) > 0.98
    assert gpu.report.coverage == pytest.approx(cpu.report.coverage, abs=1e-3)
