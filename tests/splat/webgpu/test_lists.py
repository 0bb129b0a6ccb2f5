"""Between projecting and rasterizing: the order of depth, the tiles' lists, and images of very many tiles."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pocketgs.geometry.camera import Camera
from pocketgs.gpu.sizes import ceil_div
from pocketgs.scene.gaussians import SH_DC, Gaussians
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.engine import EngineOptions
from pocketgs.splat.settings import LossSettings, StepSettings
from pocketgs.splat.webgpu.engine import WebGpuEngine
from pocketgs.splat.webgpu.layout import SPLAT_WORDS, TILE
from splat.training_step import BACKGROUND, RATES, begin, camera_in_front, of_every_size, photograph
from splat.webgpu.variants import every_variant, shared_engine

pytestmark = pytest.mark.usefixtures("adapter")

SCANS = pytest.mark.parametrize("portable", [False, True])

MakeGaussians = Callable[..., Gaussians]


def read(engine: WebGpuEngine, name: str, count: int, dtype: type = np.uint32) -> np.ndarray:
    return engine.executor.read(name, dtype, count)


def tile_lists(engine: WebGpuEngine, tiles: int) -> list[np.ndarray]:
    """The Gaussians in each tile's list, in its order, after a rendering."""
    starts = read(engine, "tile_starts", tiles + 1)
    (counted,) = read(engine, "intersection_count", 1)  # some tiles may be counted and not listed
    slots, splats = (read(engine, name, max(int(counted), 1)) for name in ("slots", "slot_splats"))
    return [splats[slots[start:end]] for start, end in pairwise(starts)]


@SCANS
@pytest.mark.parametrize("count", [1, 255, 257, 2048, 2049, 5000, 70_000])
def test_order_of_depth(portable: bool, count: int) -> None:
    """Nearest first, of equal depths the first first, what is not drawn last; over any number of blocks.

    Only Gaussians of clusters in view are sorted. Here that is every cluster with something in front of the camera.
    """
    rng = np.random.default_rng(count)
    depths = rng.choice([0.5, 1.0, 1.0 + 1e-6, 2.0, 3e4], count) * rng.choice([1.0, 1.0, -1.0], count)
    depths[rng.uniform(size=count) < 0.3] = rng.uniform(0.02, 100.0)
    means = np.stack([np.zeros(count), np.zeros(count), depths], axis=1).astype(np.float32)
    gaussians = Gaussians(
        means, np.full((count, 3), -6.0), np.ones((count, 4)), np.zeros(count), np.zeros((count, 1, 3))
    )
    engine = begin(shared_engine(EngineOptions("webgpu", portable=portable)), gaussians)
    engine.render(camera_in_front(16, 16, 16.0, distance=0.0))
    drawn = means[:, 2] > 0.0
    (ranks,) = read(engine, "gaussian_count", 1)
    assert drawn.sum() <= ranks <= count
    keys, order = read(engine, "depth_keys", ranks), read(engine, "order", ranks)
    expected = np.argsort(np.where(drawn, means[:, 2], np.inf), kind="stable")
    np.testing.assert_array_equal(order[: drawn.sum()], expected[: drawn.sum()])
    assert len(np.unique(order)) == ranks
    assert np.all(np.diff(order[drawn.sum() :].astype(np.int64)) > 0)
    np.testing.assert_array_equal(keys[: drawn.sum()].view(np.float32), means[order[: drawn.sum()], 2])
    assert np.all(keys[drawn.sum() :] == 0xFFFFFFFF)


@every_variant
def test_equal_depths_are_drawn_in_order_of_their_index(options: EngineOptions) -> None:
    """Five thousand at one depth, in more than one block: the image shows which of them came first."""
    rng = np.random.default_rng(3)
    count = 5000
    sh = ((rng.uniform(size=(count, 1, 3)) - 0.5) / SH_DC).astype(np.float32)
    means = np.concatenate([rng.uniform(-1.0, 1.0, (count, 2)), np.zeros((count, 1))], axis=1)
    gaussians = Gaussians(means, np.full((count, 3), -3.0), np.ones((count, 4)), np.full(count, 2.0), sh)
    camera = camera_in_front(40, 40, 60.0)
    rendering, expected = (
        begin(engine, gaussians).render(camera, BACKGROUND) for engine in (shared_engine(options), CpuEngine(1))
    )
    tolerance = 1e-4 if options.precision == "f32" else 1e-2
    assert np.mean(np.abs(rendering.image - expected.image) > tolerance) < 0.02


@settings(max_examples=60)
@given(st.booleans(), st.integers(0, 10_000), st.integers(1, 70), st.integers(1, 70))
def test_tile_lists_hold_every_pixel_that_a_splat_colours(portable: bool, seed: int, width: int, height: int) -> None:
    """Against brute force over all pixels: nothing that reaches 1/255 is missing, and depth order holds."""
    gaussians = of_every_size(seed)
    count = len(gaussians)
    engine = begin(shared_engine(EngineOptions("webgpu", portable=portable)), gaussians)
    engine.render(camera_in_front(width, height, 30.0))
    splats = read(engine, "splats", SPLAT_WORDS["f32"] * count, np.float32).reshape(count, -1).astype(np.float64)
    across, down = ceil_div(width, TILE), ceil_div(height, TILE)
    lists = tile_lists(engine, across * down)
    listed = np.zeros((count, height, width), bool)
    for tile, members in enumerate(lists):
        assert np.all(np.diff(splats[members, 2]) >= 0.0)
        assert len(np.unique(members)) == len(members)
        top, left = TILE * (tile // across), TILE * (tile % across)
        listed[members, top : top + TILE, left : left + TILE] = True
    drawn = read(engine, "tile_counts", count) > 0
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    for i in np.flatnonzero(drawn):
        mean_x, mean_y, _, log2_opacity, xx, xy, yy = splats[i, :7]
        dx, dy = x - mean_x, y - mean_y
        log2_alpha = log2_opacity + xx * dx * dx + xy * dx * dy + yy * dy * dy
        assert not np.any((log2_alpha > np.log2(1 / 255) + 1e-3) & ~listed[i])


def scattered(camera: Camera, count: int, radius: float, seed: int = 5) -> Gaussians:
    """Gaussians of at most `radius` pixels all over an image, a part of them in its last rows and columns."""
    rng = np.random.default_rng(seed)
    pixels = rng.uniform(size=(count, 2)) * (camera.width, camera.height)
    pixels[: count // 4] = (camera.width, camera.height) - rng.uniform(0, 3 * radius, (count // 4, 2))
    # At whole pixels and depth 1 float32 projects without rounding, even where an image is very wide.
    means = np.ones((count, 3))
    means[:, :2] = (np.round(pixels) - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    sh = (rng.uniform(size=(count, 1, 3)) - 0.5) / SH_DC
    log_scales = np.log(radius / camera.fx) + rng.uniform(-1.0, 0.0, (count, 3))
    return Gaussians(means, log_scales, rng.normal(size=(count, 4)), np.ones(count), sh)


@every_variant
@pytest.mark.parametrize(
    "size",
    [(120, 136), (128, 128), (129, 128), (2, 2000), (2000, 2)],
    ids=["255 tiles", "256 tiles", "272 tiles", "a column", "a row"],
)
def test_tiles_whose_numbers_take_more_than_a_byte(options: EngineOptions, size: tuple[int, int]) -> None:
    camera = camera_in_front(*size, focal=1024.0, distance=0.0)
    gaussians = scattered(camera, 400, 3.0)
    engine, cpu = (begin(one, gaussians) for one in (shared_engine(options), CpuEngine(1)))
    rendering, expected = (one.render(camera, BACKGROUND) for one in (engine, cpu))
    assert expected.alpha[-1, -1] > 0.0
    np.testing.assert_allclose(rendering.image, expected.image, atol=2e-2)
    assert np.mean(np.abs(rendering.image - expected.image) > (1e-4 if options.precision == "f32" else 1e-2)) < 0.01


@pytest.mark.parametrize("width", [2040, 2048, 2056], ids=["65,280 tiles", "65,536 tiles", "65,792 tiles"])
def test_more_tiles_than_a_dispatch_is_long(width: int) -> None:
    """Dispatches are folded into rows then, and the tiles' numbers take three bytes."""
    camera = camera_in_front(width, 2048, focal=2048.0, distance=0.0)
    gaussians = scattered(camera, 400, 6.0)
    rendering, expected = (begin(one, gaussians).render(camera, BACKGROUND) for one in (WebGpuEngine(), CpuEngine(1)))
    assert expected.alpha[-1, -1] > 0.0
    difference = np.abs(rendering.image - expected.image)
    assert difference.max() < 2e-2
    assert np.mean(difference[expected.alpha > 0.0] > 1e-4) < 0.01


def test_training_on_more_tiles_than_a_dispatch_is_long() -> None:
    """A ribbon of an image: of so many tiles, it has the fewest pixels whose places float32 still tells apart."""
    camera = camera_in_front(262_152, 9, focal=262_144.0, distance=0.0)
    gaussians = scattered(camera, 400, 6.0)
    frame = photograph(camera)
    engine, cpu = (begin(one, gaussians, [frame]) for one in (WebGpuEngine(), CpuEngine(1)))
    for one in (engine, cpu):
        one.step(0, StepSettings(RATES, LossSettings("l2"), background=BACKGROUND))
    assert engine.loss() == pytest.approx(cpu.loss(), rel=1e-5)
    measured, reference = (one.optimiser_state().first_moments for one in (engine, cpu))
    scale = np.abs(reference).max(axis=0)
    assert np.all(scale > 0.0)
    assert np.quantile(np.abs(measured - reference) / scale, 0.99) < 1e-3
