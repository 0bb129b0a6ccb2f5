"""The WebGPU engine under scenes that nobody would train on purpose: hostile numbers, nothing to see, far too much."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pocketgs.capture.capture import Frame
from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import PARAMETERS, Gaussians
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.engine import EngineOptions
from pocketgs.splat.settings import LossSettings, StepSettings
from pocketgs.splat.webgpu.engine import WebGpuEngine
from splat.training_step import (
    BACKGROUND,
    EDITS,
    RATES,
    a_million_off_screen,
    begin,
    camera_in_front,
    photograph,
    with_hostile_numbers,
)
from splat.webgpu.variants import VARIANTS, every_variant, shared_engine

pytestmark = pytest.mark.usefixtures("adapter")

STEP = StepSettings(RATES, LossSettings(scale_weight=1e-3), background=BACKGROUND)

MakeGaussians = Callable[..., Gaussians]


def rows(gaussians: Gaussians) -> np.ndarray:
    """(N, 11 + 3 K): all parameters of each Gaussian in a row."""
    return np.concatenate([getattr(gaussians, name).reshape(len(gaussians), -1) for name in PARAMETERS], axis=1)


@settings(max_examples=120)
@given(st.sampled_from(VARIANTS), EDITS)
def test_hostile_numbers_leave_the_image_finite(options: EngineOptions, edits: list[tuple[int, float]]) -> None:
    gaussians = with_hostile_numbers(edits)
    camera = camera_in_front(33, 21, 30.0)
    engine = begin(shared_engine(options), gaussians, [Frame("photo", camera, np.full((21, 33, 3), 128, np.uint8))])
    engine.step(0, STEP)
    # What was sound and visible stays sound: a neighbour's NaN does not spread.
    tame = np.all(np.abs(rows(gaussians)) < 50.0, axis=1)
    assert np.all(np.isfinite(rows(engine.download())[tame]))
    for scene in (gaussians, engine.download()):
        rendering = begin(engine, scene).render(camera, BACKGROUND, depth=True)
        assert rendering.depth is not None
        assert all(np.all(np.isfinite(array)) for array in (rendering.image, rendering.alpha, rendering.depth))
        assert rendering.alpha.min() >= 0.0
        assert rendering.alpha.max() <= 1.0


@every_variant
@pytest.mark.parametrize("log_scale", [20.0, 40.0, 60.0, 88.0, 100.0])
@pytest.mark.parametrize("axes", [1, 2, 3])
def test_a_gaussian_that_has_diverged_is_not_drawn(
    camera: Camera, make_gaussians: MakeGaussians, options: EngineOptions, log_scale: float, axes: int
) -> None:
    gaussians = make_gaussians(count=5)
    gaussians.log_scales[2, :axes] = log_scale
    rendering = begin(shared_engine(options), gaussians).render(camera)
    assert np.all(np.isfinite(rendering.image))
    without = begin(shared_engine(options), gaussians.select(np.array([0, 1, 3, 4]))).render(camera)
    np.testing.assert_array_equal(without.image, rendering.image)


@every_variant
@pytest.mark.parametrize("logit", [-20.0, -1e30, -np.inf])
def test_transparent_gaussians_show_and_learn_nothing(
    camera: Camera, make_gaussians: MakeGaussians, options: EngineOptions, logit: float
) -> None:
    gaussians = make_gaussians(count=30)
    gaussians.opacity_logits[:] = logit
    engine = begin(shared_engine(options), gaussians, [photograph(camera)])
    rendering = engine.render(camera, BACKGROUND, depth=True)
    np.testing.assert_array_equal(rendering.image, np.broadcast_to(np.float32(BACKGROUND), rendering.image.shape))
    assert not rendering.alpha.any()
    assert rendering.depth is not None
    assert not rendering.depth.any()
    engine.step(0, StepSettings(RATES))
    assert not engine.optimiser_state().first_moments.any()


@every_variant
@pytest.mark.parametrize("logit", [20.0, 1e30])
def test_opaque_gaussians_hide_what_is_behind(camera: Camera, options: EngineOptions, logit: float) -> None:
    """A red wall before a green one: three or four layers of it let nothing through."""
    depths = np.repeat([0.0, 0.1, 0.2, 0.3, 2.0], 1)
    means = np.stack([np.zeros(5), np.zeros(5), depths], axis=1)
    sh = np.zeros((5, 1, 3))
    sh[:4, 0] = (1.7, -1.7, -1.7)
    sh[4, 0] = (-1.7, 1.7, -1.7)
    wall = Gaussians(means, np.full((5, 3), np.log(50.0)), np.ones((5, 4)), np.full(5, logit), sh)
    rendering = begin(shared_engine(options), wall).render(camera, BACKGROUND)
    expected = begin(CpuEngine(1), wall).render(camera, BACKGROUND)
    np.testing.assert_allclose(rendering.image, expected.image, atol=1e-3)
    assert rendering.image[..., 1].max() < 0.03


@every_variant
def test_gaussians_behind_and_around_the_camera(make_gaussians: MakeGaussians, options: EngineOptions) -> None:
    gaussians = make_gaussians(count=500, sh_degree=1, size=0.2)
    camera = camera_in_front(60, 40, 40.0, distance=0.0)
    frame = photograph(camera)
    engine, cpu = (begin(one, gaussians, [frame]) for one in (shared_engine(options), CpuEngine(1)))
    rendering, expected = (one.render(camera, BACKGROUND) for one in (engine, cpu))
    tolerance = 1e-4 if options.precision == "f32" else 1e-2
    assert np.mean(np.abs(rendering.image - expected.image) > tolerance) < 0.01
    for one in (engine, cpu):
        one.step(0, STEP)
    measured, reference = (one.optimiser_state().first_moments for one in (engine, cpu))
    assert np.all(np.isfinite(measured))
    # Whoever is not seen has no gradient but the regulariser's.
    behind = gaussians.means[:, 2] < 0.0
    assert not measured[behind][:, np.r_[0:3, 6:22]].any()
    scale = np.abs(reference).max(axis=0)
    assert np.quantile(np.abs(measured - reference) / scale, 0.99) < (1e-3 if options.precision == "f32" else 5e-2)
    nothing = begin(engine, gaussians.select(behind)).render(camera, BACKGROUND)
    assert not nothing.alpha.any()


@every_variant
@pytest.mark.parametrize("count", [0, 1])
@pytest.mark.parametrize("size", [(1, 1), (9, 3), (17, 33)])
def test_few_gaussians_and_small_images(
    make_gaussians: MakeGaussians, options: EngineOptions, count: int, size: tuple[int, int]
) -> None:
    camera = camera_in_front(*size, focal=20.0)
    engine, cpu = (
        begin(one, make_gaussians(count=count), [photograph(camera)]) for one in (shared_engine(options), CpuEngine(1))
    )
    for one in (engine, cpu):
        for _ in range(3):
            one.step(0, STEP)
    tolerance = 1e-4 if options.precision == "f32" else 1e-2
    assert engine.loss(3) == pytest.approx(cpu.loss(3), rel=tolerance)
    result = engine.download()
    assert len(result) == len(engine.optimiser_state().first_moments) == count
    assert all(np.all(np.isfinite(getattr(result, name))) for name in PARAMETERS)
    np.testing.assert_allclose(engine.render(camera).image, cpu.render(camera).image, atol=tolerance)


def test_a_million_gaussians_off_screen() -> None:
    gaussians = a_million_off_screen()
    engine = begin(WebGpuEngine(), gaussians)
    assert engine.render(camera_in_front(40, 30, 40.0), BACKGROUND).alpha.max() == 0.0
