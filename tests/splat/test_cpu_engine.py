"""The CPU engine on any input: the same bits every time, and no crash."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pocketgs.capture.capture import Frame
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import PARAMETERS, Gaussians
from pocketgs.splat.choose_engine import create_engine
from pocketgs.splat.cpu.adam import adam
from pocketgs.splat.cpu.bin import with_slack
from pocketgs.splat.cpu.dssim import dssim
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.cpu.layout import (
    DEPTH,
    INTERSECTION_ROWS,
    INTERSECTION_SPLAT,
    TILE_HEIGHT,
    TILE_WIDTH,
    View,
    tiles_down,
)
from pocketgs.splat.cpu.lenses.lens import kernel_lens
from pocketgs.splat.cpu.loss import pointwise
from pocketgs.splat.cpu.project import project
from pocketgs.splat.cpu.project_backward import project_backward
from pocketgs.splat.cpu.rasterize import rasterize
from pocketgs.splat.cpu.rasterize_backward import rasterize_backward
from pocketgs.splat.cpu.sort import sort_by_depth
from pocketgs.splat.engine import EngineOptions
from pocketgs.splat.settings import LearningRates, LossSettings, StepSettings
from pocketgs.splat.timing import PassTimer
from splat.training_step import (
    EDITS,
    a_million_off_screen,
    assert_identical,
    camera_in_front,
    of_every_size,
    photograph,
    with_hostile_numbers,
)

STEP = StepSettings(LearningRates(1e-3, 5e-3, 4e-3, 1e-2, 1e-2, 1e-3), LossSettings(scale_weight=1e-3))

MakeGaussians = Callable[..., Gaussians]


def train(gaussians: Gaussians, camera: Camera, steps: int, threads: int) -> Gaussians:
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (camera.height, camera.width, 3)).astype(np.uint8)
    engine = CpuEngine(threads)
    engine.set_views([Frame("photo", camera, image)])
    engine.upload(gaussians)
    for _ in range(steps):
        engine.step(0, STEP)
    return engine.download()


def test_same_bits_every_time_and_on_any_number_of_threads(make_gaussians: MakeGaussians) -> None:
    camera = camera_in_front(150, 110, 150.0)
    gaussians = make_gaussians(count=3000, sh_degree=1, size=0.05)
    first = train(gaussians, camera, 5, threads=2)
    assert_identical(first, train(gaussians, camera, 5, threads=2))
    assert_identical(first, train(gaussians, camera, 5, threads=1))


def test_state_restores_training(camera: Camera, make_gaussians: MakeGaussians) -> None:
    gaussians = make_gaussians(count=50, sh_degree=0)
    whole = train(gaussians, camera, 6, threads=1)
    rng = np.random.default_rng(0)
    frame = Frame("photo", camera, rng.integers(0, 256, (camera.height, camera.width, 3)).astype(np.uint8))
    engine = CpuEngine(1)
    engine.set_views([frame])
    engine.upload(gaussians)
    for _ in range(3):
        engine.step(0, STEP)
    resumed = CpuEngine(1)
    resumed.set_views([frame])
    resumed.upload(engine.download(), engine.optimiser_state())
    for _ in range(3):
        resumed.step(0, STEP)
    assert_identical(whole, resumed.download())


def test_the_loss_of_some_steps_is_their_mean(camera: Camera, make_gaussians: MakeGaussians) -> None:
    engine = CpuEngine(1)
    engine.set_views([photograph(camera)])
    engine.upload(make_gaussians(count=20, sh_degree=0))
    losses = []
    for _ in range(4):
        engine.step(0, STEP)
        losses.append(engine.loss())
    assert len(set(losses)) == 4
    assert engine.loss(3) == pytest.approx(np.mean(losses[1:]), rel=1e-6)


def test_training_brings_the_loss_down(camera: Camera, make_gaussians: MakeGaussians) -> None:
    target, start = make_gaussians(count=60, sh_degree=0, seed=1), make_gaussians(count=60, sh_degree=0, seed=2)
    painter = CpuEngine()
    painter.upload(target)
    photo = np.round(np.clip(painter.render(camera).image, 0, 1) * 255).astype(np.uint8)
    engine = CpuEngine()
    engine.set_views([Frame("photo", camera, photo)])
    engine.upload(start)
    engine.step(0, STEP)
    before = engine.loss()
    for _ in range(200):
        engine.step(0, STEP)
    assert engine.loss() < 0.35 * before


@pytest.mark.parametrize("count", [0, 1])
@pytest.mark.parametrize("size", [(1, 1), (9, 3), (17, 33)])
def test_few_gaussians_and_small_images(make_gaussians: MakeGaussians, count: int, size: tuple[int, int]) -> None:
    camera = camera_in_front(*size, 20.0)
    result = train(make_gaussians(count=count), camera, 3, threads=2)
    assert len(result) == count
    assert all(np.all(np.isfinite(getattr(result, name))) for name in PARAMETERS)


@settings(max_examples=60)
@given(EDITS)
def test_hostile_numbers_leave_the_image_finite(edits: list[tuple[int, float]]) -> None:
    gaussians = with_hostile_numbers(edits)
    parameters = [getattr(gaussians, name) for name in PARAMETERS]
    camera = camera_in_front(33, 21, 30.0)
    engine = CpuEngine()
    engine.set_views([Frame("photo", camera, np.full((21, 33, 3), 128, np.uint8))])
    engine.upload(gaussians)
    assert np.all(np.isfinite(engine.render(camera).alpha))
    engine.step(0, STEP)
    # What was sound and visible stays sound: a neighbour's NaN does not spread.
    before_sound = np.all([np.isfinite(a.reshape(20, -1)).all(axis=1) for a in parameters], axis=0)
    tame = np.all([np.abs(a.reshape(20, -1)).max(axis=1) < 50 for a in parameters], axis=0)
    after = engine.download()
    for name in ("means", "opacity_logits", "sh"):
        assert np.all(np.isfinite(getattr(after, name)[before_sound & tame]))


def test_a_million_gaussians_off_screen() -> None:
    gaussians = a_million_off_screen()
    camera = camera_in_front(40, 30, 40.0)
    engine = CpuEngine()
    engine.upload(gaussians)
    assert engine.render(camera, (0.1, 0.2, 0.3)).alpha.max() == 0.0


@settings(max_examples=40)
@given(st.integers(0, 10_000), st.integers(1, 70), st.integers(1, 70))
def test_tile_lists_hold_every_pixel_that_a_splat_colours(seed: int, width: int, height: int) -> None:
    """Comparison with all pixels by brute force: no contribution of 1/255 is missing, and depth order is kept."""
    gaussians = of_every_size(seed)
    count = len(gaussians)
    camera = camera_in_front(width, height, 30.0)
    engine = CpuEngine(2)
    engine.upload(gaussians)
    view = View.of(camera)
    raster = engine._forward(view, kernel_lens(camera), np.zeros(3, np.float32))
    listed = np.zeros((count, height, width), bool)
    for tile in range(view.tiles):
        intersections = raster.lists.intersections[raster.lists.ranges[tile] : raster.lists.ranges[tile + 1]]
        depths = engine._buffers.splats[intersections[:, INTERSECTION_SPLAT], DEPTH]
        assert np.all(np.diff(depths) >= 0)
        left = tile // tiles_down(height) * TILE_WIDTH
        top = tile % tiles_down(height) * TILE_HEIGHT
        for intersection in intersections:
            first, end = intersection[INTERSECTION_ROWS] >> 8, intersection[INTERSECTION_ROWS] & 255
            assert 0 <= first < end <= TILE_HEIGHT
            listed[intersection[INTERSECTION_SPLAT], top + first : top + end, left : left + TILE_WIDTH] = True
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    for i in raster.order:
        splat = engine._buffers.splats[i].astype(np.float64)
        dx, dy = x - splat[0], y - splat[1]
        log2_alpha = splat[5] + splat[2] * dx * dx + splat[3] * dx * dy + splat[4] * dy * dy
        assert not np.any((log2_alpha > np.log2(1 / 255) + 1e-3) & ~listed[i])


def test_room_for_more_intersections_than_a_fifth_of_int32() -> None:
    """Their number is of that type, and five times it would overflow."""
    assert with_slack(np.int32(500_000_000)) == 625_000_000
    assert with_slack(np.int64(7)) == 8


def test_images_of_as_many_tiles_but_other_sizes(make_gaussians: MakeGaussians) -> None:
    gaussians, engine = make_gaussians(count=30), CpuEngine()
    engine.upload(gaussians)
    for width, height in ((40, 30), (37, 32), (40, 30), (16, 80)):
        camera, fresh = camera_in_front(width, height, 40.0), CpuEngine()
        fresh.upload(gaussians)
        np.testing.assert_array_equal(engine.render(camera).image, fresh.render(camera).image)


def test_an_unknown_engine_is_refused() -> None:
    with pytest.raises(PocketGSError, match="auto, cpu, webgpu"):
        create_engine(EngineOptions("cuda"))  # type: ignore[arg-type]


@pytest.mark.parametrize("log_scale", [20.0, 40.0, 60.0, 88.0, 100.0])
@pytest.mark.parametrize("axes", [1, 2, 3])
def test_a_gaussian_that_has_diverged_is_not_drawn(
    camera: Camera, make_gaussians: MakeGaussians, log_scale: float, axes: int
) -> None:
    gaussians = make_gaussians(count=5)
    gaussians.log_scales[2, :axes] = log_scale
    engine = CpuEngine()
    engine.upload(gaussians)
    rendering = engine.render(camera)
    assert np.all(np.isfinite(rendering.image))
    engine.upload(gaussians.select(np.array([0, 1, 3, 4])))
    np.testing.assert_array_equal(engine.render(camera).image, rendering.image)


def test_no_step_compiles_what_prepare_has_not() -> None:
    kernels = [project, sort_by_depth, rasterize, rasterize_backward, project_backward, adam]
    kernels += [pointwise, dssim]
    CpuEngine().prepare()
    before = [len(function.signatures) for function in kernels]  # type: ignore[attr-defined]
    assert min(before) >= 1
    camera = camera_in_front(40, 30, 30.0)
    mask = np.ones((30, 40), np.bool_)
    mask.setflags(write=False)
    rng = np.random.default_rng(3)
    gaussians = Gaussians(rng.normal(size=(9, 3)), np.zeros((9, 3)), np.ones((9, 4)), np.zeros(9), np.zeros((9, 9, 3)))
    engine = CpuEngine()
    for photometric in ("l2", "l1-dssim"):
        for frame_mask in (None, mask):
            engine.set_views([Frame("photo", camera, np.zeros((30, 40, 3), np.uint8), mask=frame_mask)])
            engine.upload(gaussians)
            loss = LossSettings(photometric, scale_weight=1.0)  # type: ignore[arg-type]
            engine.step(0, StepSettings(STEP.rates, loss))
            engine.render(camera, depth=True)
    assert [len(function.signatures) for function in kernels] == before  # type: ignore[attr-defined]


def test_a_timer_times_every_pass(camera: Camera, make_gaussians: MakeGaussians) -> None:
    engine = CpuEngine()
    engine.set_views([Frame("photo", camera, np.zeros((camera.height, camera.width, 3), np.uint8))])
    engine.upload(make_gaussians())
    engine.step(0, STEP)
    engine.timer = PassTimer()
    engine.step(0, STEP)
    engine.render(camera)
    forward = ["cull", "project", "sort", "bin", "rasterize"]
    assert list(engine.timer.milliseconds) == [*forward, "loss", "rasterize backward", "project backward", "Adam"]
    assert [len(engine.timer.milliseconds[name]) for name in (*forward, "loss")] == [2] * 5 + [1]
