"""The WebGPU engine against the reference and against the CPU engine: images, losses, gradients, training."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pocketgs.capture.capture import Frame
from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.engine import Engine, EngineOptions
from pocketgs.splat.reference.project import project
from pocketgs.splat.reference.rasterize import rasterize
from pocketgs.splat.reference.scene import Scene
from pocketgs.splat.settings import LossSettings, StepSettings
from splat.training_step import BACKGROUND, RATES, begin, camera_in_front, columns, photograph, reference_step
from splat.webgpu.variants import EXACT, every_variant, shared_engine

pytestmark = pytest.mark.usefixtures("adapter")

MakeGaussians = Callable[..., Gaussians]

GROUPS = {"means": (0, 3), "log scales": (3, 6), "rotations": (6, 9), "opacity": (9, 10), "sh": (10, None)}


def assert_alike(measured: np.ndarray, expected: np.ndarray, tolerance: float, most: float = 0.02) -> None:
    """A contribution at the very edge of 1/255 may fall on either side: at few pixels, by not much more than that."""
    difference = np.abs(measured - expected)
    assert np.mean(difference > tolerance) < 0.01
    assert difference.max() < max(most, 3 * tolerance)


def assert_gradients_agree(measured: np.ndarray, expected: np.ndarray, tolerance: float) -> None:
    for name, (start, end) in GROUPS.items():
        scale = np.abs(expected[:, start:end]).max()
        error = np.abs(measured[:, start:end] - expected[:, start:end])
        assert np.quantile(error, 0.99) < tolerance * scale, name
        assert error.max() < max(2e-2, 5 * tolerance) * scale, name


@every_variant
@pytest.mark.parametrize(("count", "size"), [(1, 0.3), (12, 0.2), (300, 0.08), (2000, 0.03), (40, 2.0)])
def test_renderings_agree(
    camera: Camera, make_gaussians: MakeGaussians, options: EngineOptions, count: int, size: float
) -> None:
    gaussians = make_gaussians(count=count, size=size, seed=count)
    engine = begin(shared_engine(options), gaussians)
    rendering = engine.render(camera, BACKGROUND, depth=True)
    raster = rasterize(project(Scene.of(gaussians), camera), camera, np.array(BACKGROUND))
    exact = EXACT[options.precision]
    alpha = 1.0 - raster.transmittance
    assert_alike(rendering.image, raster.image, exact.image)
    assert_alike(rendering.alpha, alpha, exact.image)
    solid = alpha > 0.05
    expected = raster.depth[solid] / alpha[solid]
    assert rendering.depth is not None
    assert np.mean(np.abs(rendering.depth[solid] / expected - 1.0) > exact.depth) < 0.01
    assert np.all(rendering.depth[rendering.alpha == 0.0] == 0.0)


@every_variant
@pytest.mark.parametrize("size", [(1, 1), (7, 9), (8, 8), (65, 16), (150, 110)])
def test_renderings_agree_with_the_cpu_engine(
    make_gaussians: MakeGaussians, options: EngineOptions, size: tuple[int, int]
) -> None:
    camera = camera_in_front(*size, focal=max(size))
    gaussians = make_gaussians(count=3000, sh_degree=1, size=0.05)
    rendering = begin(shared_engine(options), gaussians).render(camera, BACKGROUND, depth=True)
    expected = begin(CpuEngine(1), gaussians).render(camera, BACKGROUND, depth=True)
    exact = EXACT[options.precision]
    assert_alike(rendering.image, expected.image, exact.image)
    assert_alike(rendering.alpha, expected.alpha, exact.image)
    assert rendering.depth is not None
    assert expected.depth is not None
    assert_alike(rendering.depth, expected.depth, 4.0 * exact.depth, most=0.1)
    assert [array.dtype for array in (rendering.image, rendering.alpha, rendering.depth)] == [np.float32] * 3


@every_variant
@pytest.mark.parametrize("sh_degree", [0, 1, 2, 3])
@pytest.mark.parametrize("photometric", ["l2", "l1-dssim"])
@pytest.mark.parametrize("masked", [False, True])
def test_gradients_agree(
    camera: Camera,
    make_gaussians: MakeGaussians,
    options: EngineOptions,
    sh_degree: int,
    photometric: str,
    masked: bool,
) -> None:
    gaussians = make_gaussians(count=60, sh_degree=sh_degree, size=0.15, seed=sh_degree)
    frame = photograph(camera, masked)
    loss_settings = LossSettings(photometric, 0.2, scale_weight=0.01, opacity_weight=0.02)  # type: ignore[arg-type]
    settings = StepSettings(RATES, loss_settings, background=BACKGROUND)
    engine, cpu = (begin(one, gaussians, [frame]) for one in (shared_engine(options), CpuEngine(1)))
    engine.step(0, settings)
    cpu.step(0, settings)
    exact = EXACT[options.precision]
    loss, gradient, _ = reference_step(Scene.of(gaussians), frame, settings)
    assert engine.loss() == pytest.approx(loss, rel=exact.image)
    # After the first step the first moment is (1 - β₁) times the gradient.
    measured = engine.optimiser_state().first_moments / (1.0 - settings.adam.beta1)
    assert_gradients_agree(measured, columns(gradient), exact.gradient)
    on_cpu = cpu.optimiser_state().first_moments / (1.0 - settings.adam.beta1)
    assert_gradients_agree(measured, on_cpu, exact.gradient)


@every_variant
def test_gradients_agree_through_many_layers(
    camera: Camera, make_gaussians: MakeGaussians, options: EngineOptions
) -> None:
    """More contributions to a pixel than a replay cache has room for, and tiles of several batches."""
    gaussians = make_gaussians(count=300, sh_degree=1, size=0.8)
    gaussians.opacity_logits -= 2.0
    frame = photograph(camera, masked=True)
    settings = StepSettings(RATES, background=BACKGROUND)
    engine = begin(shared_engine(options), gaussians, [frame])
    engine.step(0, settings)
    _, gradient, _ = reference_step(Scene.of(gaussians), frame, settings)
    measured = engine.optimiser_state().first_moments / (1.0 - settings.adam.beta1)
    assert_gradients_agree(measured, columns(gradient), EXACT[options.precision].gradient)


@every_variant
@pytest.mark.parametrize("side", [(1.0, 0.0), (-1.0, 0.0), (0.0, 0.8), (0.0, -0.8), (-0.8, 0.7)])
def test_gradients_agree_beside_the_image(
    make_gaussians: MakeGaussians, options: EngineOptions, side: tuple[float, float]
) -> None:
    """Large Gaussians whose centres lie so far outside that their Jacobians are clamped."""
    gaussians = make_gaussians(count=40, sh_degree=1, size=0.8)
    depths = 4.0 + gaussians.means[:, 2]
    gaussians.means[:, :2] = 0.2 * gaussians.means[:, :2] + np.outer(depths, side)
    gaussians.log_scales = np.minimum(gaussians.log_scales, 0.5)
    frame = photograph(camera_in_front(37, 29, 40.0))
    settings = StepSettings(RATES, background=BACKGROUND)
    engine = begin(shared_engine(options), gaussians, [frame])
    engine.step(0, settings)
    _, gradient, _ = reference_step(Scene.of(gaussians), frame, settings)
    expected = columns(gradient)
    assert np.count_nonzero(expected[:, 9]) >= 10
    measured = engine.optimiser_state().first_moments / (1.0 - settings.adam.beta1)
    assert_gradients_agree(measured, expected, 2 * EXACT[options.precision].gradient)


@every_variant
@pytest.mark.parametrize("size", [(29, 37), (11, 11), (12, 40), (64, 17), (10, 30), (1, 1)])
def test_losses_agree_at_every_size(
    make_gaussians: MakeGaussians, options: EngineOptions, size: tuple[int, int]
) -> None:
    gaussians = make_gaussians(count=40, sh_degree=0, size=0.3)
    frame = photograph(camera_in_front(*size, focal=20.0), masked=True)
    settings = StepSettings(RATES, LossSettings("l1-dssim", 0.4), background=BACKGROUND)
    engine = begin(shared_engine(options), gaussians, [frame])
    engine.step(0, settings)
    exact = EXACT[options.precision]
    loss, gradient, _ = reference_step(Scene.of(gaussians), frame, settings)
    assert engine.loss() == pytest.approx(loss, rel=exact.image)
    measured = engine.optimiser_state().first_moments / (1.0 - settings.adam.beta1)
    assert_gradients_agree(measured, columns(gradient), exact.gradient)


def squared_error(engine: Engine, frames: list[Frame]) -> float:
    errors = [(engine.render(frame.camera, BACKGROUND).image - frame.image / 255.0) ** 2 for frame in frames]
    return float(np.mean(errors))


@every_variant
@pytest.mark.parametrize("photometric", ["l2", "l1-dssim"])
def test_thirty_steps_end_as_on_the_cpu(
    make_gaussians: MakeGaussians, options: EngineOptions, photometric: str
) -> None:
    cameras = [camera_in_front(64, 48, 60.0, distance) for distance in (4.0, 5.0)]
    painter = begin(CpuEngine(1), make_gaussians(count=100, sh_degree=1, seed=1))
    photos = [np.clip(painter.render(camera, BACKGROUND).image, 0.0, 1.0) for camera in cameras]
    frames = [
        Frame("photo", camera, np.round(255 * photo).astype(np.uint8))
        for camera, photo in zip(cameras, photos, strict=True)
    ]
    gaussians = make_gaussians(count=100, sh_degree=1, seed=2)
    settings = StepSettings(RATES, LossSettings(photometric), background=BACKGROUND)  # type: ignore[arg-type]
    engine, cpu = (begin(one, gaussians, frames) for one in (shared_engine(options), CpuEngine(1)))
    before = squared_error(cpu, frames)
    losses = []
    for iteration in range(30):
        for one in (engine, cpu):
            one.step(iteration % 2, settings)
        losses.append((engine.loss(), cpu.loss()))
    measured, expected = np.array(losses).T
    np.testing.assert_allclose(measured, expected, rtol=EXACT[options.precision].loss)
    after = squared_error(engine, frames)
    assert after < 0.5 * before
    assert abs(10.0 * np.log10(after / squared_error(cpu, frames))) < 0.05


@every_variant
def test_fifteen_steps_agree_with_the_reference(
    camera: Camera, make_gaussians: MakeGaussians, options: EngineOptions
) -> None:
    gaussians = make_gaussians(count=80, sh_degree=1, size=0.12)
    frame = photograph(camera)
    settings = StepSettings(RATES, LossSettings(), background=BACKGROUND)
    engine = begin(shared_engine(options), gaussians, [frame])
    scene, moments = Scene.of(gaussians), None
    for _ in range(15):
        engine.step(0, settings)
        loss, _, moments = reference_step(scene, frame, settings, moments)
    exact = EXACT[options.precision]
    assert engine.loss() == pytest.approx(loss, rel=max(2e-3, exact.loss))
    result = engine.download()
    for name, tolerance in (("means", 2e-3), ("log_scales", 2e-2), ("opacity_logits", 2e-2)):
        assert np.quantile(np.abs(getattr(result, name) - getattr(scene, name)), 0.95) < tolerance, name
