"""Every pass of a sweep on the GPU against its Numba twin, given what the passes before it have left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
import pytest

from pocketgs.capture.capture import Frame
from pocketgs.capture.synthetic import true_capture
from pocketgs.prior.depth.cpu.matching_cost import matching_costs, squares_of
from pocketgs.prior.depth.cpu.semi_global import EIGHT_PATHS, FOUR_PATHS, aggregate, winners
from pocketgs.prior.depth.cpu.stereo import CpuStereo, as_source_views, grey_levels, smoothed
from pocketgs.prior.depth.depth_range import DepthRange
from pocketgs.prior.depth.sweep import DepthMap, SweepSettings
from pocketgs.prior.depth.sweep_constants import BITS
from pocketgs.prior.depth.webgpu.layout import LANE
from pocketgs.prior.depth.webgpu.stereo import WebGpuStereo

pytestmark = pytest.mark.usefixtures("adapter")

MOST_UNLIKE = 0.002
"""Share of costs that rounding may change: a census flips where two samples are all but alike."""


@dataclass(frozen=True, eq=False)
class Case:
    """One sweep."""

    keyframe: Frame
    source_views: Sequence[Frame]
    search: DepthRange
    settings: SweepSettings = field(default_factory=SweepSettings)


@cache
def stereo() -> WebGpuStereo:
    """Its pipelines are compiled once for all tests."""
    return WebGpuStereo()


@cache
def room() -> list[Frame]:
    """Views of the demo's room, 57 x 42: no patch and no workgroup divides them."""
    return true_capture(57, 42, frames=6, points=10).train


def with_mask(frame: Frame, left: int, right: int) -> Frame:
    """Somebody stands in the picture."""
    mask = np.ones(frame.image.shape[:2], bool)
    mask[8:30, left:right] = False
    return replace(frame, mask=mask)


def with_alpha(frame: Frame) -> Frame:
    alpha = np.full(frame.image.shape[:2], 255, np.uint8)
    alpha[:, :20] = 90
    return replace(frame, alpha=alpha)


def smaller(frame: Frame, width: int, height: int) -> Frame:
    """The upper left part of a photograph."""
    camera = replace(frame.camera, width=width, height=height)
    return Frame(frame.name, camera, frame.image[:height, :width])


def frames() -> tuple[Frame, list[Frame]]:
    """A keyframe and its four source views."""
    key, *others = room()
    return key, others[:4]


@cache
def cases() -> dict[str, Case]:
    key, others = frames()
    depth = key.depth
    assert depth is not None
    near, far = 0.8 * float(depth.min()), 1.3 * float(depth.max())
    usual = DepthRange(near, far, 50)
    odd_sizes = [smaller(others[0], 31, 42), smaller(others[1], 57, 23), others[2]]
    return {
        "usual": Case(key, others, usual),
        "to infinity": Case(key, others, DepthRange(near, np.inf, 64)),
        "four paths": Case(key, others, replace(usual, hypotheses=33), SweepSettings(paths=4, small_step=3)),
        "one source view": Case(key, others[:1], replace(usual, hypotheses=9)),
        "masks and alpha": Case(with_alpha(with_mask(key, 20, 35)), [with_mask(others[0], 5, 22), *others[1:3]], usual),
        "sizes": Case(smaller(key, 44, 17), odd_sizes, replace(usual, hypotheses=192)),
        "a single row": Case(smaller(key, 57, 1), others, usual),
        "a single column": Case(smaller(key, 1, 42), others, usual),
    }


every_case = pytest.mark.parametrize("name", list(cases()))


def shape_of(case: Case) -> tuple[int, int, int]:
    rows, columns = case.keyframe.image.shape[:2]
    return rows, columns, case.search.hypotheses


def volume(name: str, dtype: type[np.generic], case: Case) -> np.ndarray:
    """(H, W, D) a volume that the last sweep has left in one band."""
    rows, columns, hypotheses = shape_of(case)
    padded = -(-hypotheses // LANE) * LANE
    content = stereo().sweeping.read(name, dtype, rows * columns * padded)
    return np.ascontiguousarray(content.reshape(rows, columns, padded)[..., :hypotheses])


def image(name: str, case: Case) -> np.ndarray:
    rows, columns, _ = shape_of(case)
    return stereo().sweeping.read(name, np.float32, rows * columns).reshape(rows, columns)


def swept(case: Case) -> DepthMap:
    return stereo().sweep(case.keyframe, case.source_views, case.search, case.settings)


def test_squares_are_those_of_the_greyscale_images() -> None:
    case = cases()["sizes"]
    swept(case)
    height, width = (max(frame.image.shape[side] for frame in case.source_views) for side in (0, 1))
    count = len(case.source_views)
    found = stereo().sweeping.read("squares", np.uint32, count * height * width).reshape(count, height, width)
    for squares, frame in zip(found, case.source_views, strict=True):
        rows, columns = frame.image.shape[:2]
        np.testing.assert_array_equal(squares[:rows, :columns], squares_of(grey_levels(frame)))


@every_case
def test_costs(name: str) -> None:
    case = cases()[name]
    swept(case)
    found = volume("costs_0", np.uint8, case)
    source_views = as_source_views(case.keyframe.camera, case.source_views)
    expected = matching_costs(grey_levels(case.keyframe), source_views, case.search.inverse_depths)
    if case.keyframe.mask is not None:
        expected[~case.keyframe.mask] = BITS // 2
    assert np.mean(found != expected) < MOST_UNLIKE


@every_case
def test_sums_along_paths_are_the_same(name: str) -> None:
    case = cases()[name]
    swept(case)
    costs, settings = volume("costs_0", np.uint8, case), case.settings
    paths = EIGHT_PATHS if settings.paths == 8 else FOUR_PATHS
    expected = aggregate(costs, grey_levels(case.keyframe), paths, settings.small_step, settings.large_step)
    np.testing.assert_array_equal(volume("totals_0", np.uint16, case), expected)


@every_case
def test_winners(name: str) -> None:
    case = cases()[name]
    found = swept(case)
    depth, margin = winners(volume("totals_0", np.uint16, case), case.search.inverse_depths, case.settings.paths)
    if np.isfinite(case.search.farthest):
        depth[depth * case.search.inverse_depths[0] > 1 - 1e-6] = 0
    if case.keyframe.usable is not None:
        depth[~case.keyframe.usable] = 0
    np.testing.assert_allclose(image("winner_depths", case), depth, rtol=1e-6)
    np.testing.assert_allclose(found.margin, margin, rtol=1e-6)


@every_case
def test_smoothing(name: str) -> None:
    case = cases()[name]
    found = swept(case)
    expected = smoothed(image("winner_depths", case), found.step)
    np.testing.assert_array_equal(found.depth > 0, expected > 0)
    known = expected > 0
    steps = np.abs(1 / found.depth[known] - 1 / expected[known]) / found.step
    assert steps.max(initial=0) < 1e-3


@pytest.mark.parametrize("name", ["usual", "to infinity", "masks and alpha"])
def test_the_depth_map_is_the_cpus(name: str) -> None:
    case = cases()[name]
    found = swept(case)
    expected = CpuStereo().sweep(case.keyframe, case.source_views, case.search, case.settings)
    assert found.step == expected.step
    assert found.depth.dtype == found.margin.dtype == np.float32
    assert np.mean((found.depth > 0) != (expected.depth > 0)) < 0.005
    both = (found.depth > 0) & (expected.depth > 0)
    assert np.mean(both) > 0.5
    steps = np.abs(1 / found.depth[both] - 1 / expected.depth[both]) / expected.step
    assert np.mean(steps < 0.01) > 0.98
    assert np.mean(np.abs(found.margin - expected.margin) < 0.01) > 0.98


def test_without_source_views_no_depth_is_known() -> None:
    case = cases()["usual"]
    found = stereo().sweep(case.keyframe, [], case.search, case.settings)
    assert found.depth.shape == found.margin.shape == (42, 57)
    assert not found.depth.any()
    assert not found.margin.any()
