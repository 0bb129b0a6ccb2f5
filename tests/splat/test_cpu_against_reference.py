"""The CPU engine against the reference: images, losses, gradients, whole training steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.cpu.loss import photometric
from pocketgs.splat.reference.loss import photometric_loss
from pocketgs.splat.reference.project import project
from pocketgs.splat.reference.rasterize import rasterize
from pocketgs.splat.reference.scene import Scene
from pocketgs.splat.settings import AdamSettings, LossSettings, StepSettings
from splat.training_step import BACKGROUND, RATES, columns, photograph, reference_step

MakeGaussians = Callable[..., Gaussians]


@pytest.mark.parametrize(("count", "size"), [(1, 0.3), (12, 0.2), (300, 0.08), (2000, 0.03), (40, 2.0)])
def test_renderings_agree(camera: Camera, make_gaussians: MakeGaussians, count: int, size: float) -> None:
    gaussians = make_gaussians(count=count, size=size, seed=count)
    engine = CpuEngine()
    engine.upload(gaussians)
    rendering = engine.render(camera, BACKGROUND, depth=True)
    scene = Scene.of(gaussians)
    raster = rasterize(project(scene, camera), camera, np.array(BACKGROUND))
    alpha = 1.0 - raster.transmittance
    # A contribution at the very edge of 1/255 may fall on either side: at most a handful of pixels, by at most that.
    difference = np.abs(rendering.image - raster.image).max(axis=2)
    assert np.mean(difference > 1e-4) < 0.01
    assert difference.max() < 0.02
    assert np.mean(np.abs(rendering.alpha - alpha) > 1e-4) < 0.01
    solid = alpha > 0.05
    expected = raster.depth[solid] / alpha[solid]
    assert rendering.depth is not None
    assert np.mean(np.abs(rendering.depth[solid] - expected) > 1e-3) < 0.01


@pytest.mark.parametrize("sh_degree", [0, 1, 2, 3])
@pytest.mark.parametrize("photometric_name", ["l2", "l1-dssim"])
@pytest.mark.parametrize("masked", [False, True])
def test_gradients_agree(
    camera: Camera, make_gaussians: MakeGaussians, sh_degree: int, photometric_name: str, masked: bool
) -> None:
    gaussians = make_gaussians(count=60, sh_degree=sh_degree, size=0.15, seed=sh_degree)
    frame = photograph(camera, masked)
    loss_settings = LossSettings(photometric_name, 0.2, scale_weight=0.01, opacity_weight=0.02)  # type: ignore[arg-type]
    settings = StepSettings(RATES, loss_settings, background=BACKGROUND)
    engine = CpuEngine()
    engine.set_views([frame])
    engine.upload(gaussians)
    engine.step(0, settings)
    loss, gradient, _ = reference_step(Scene.of(gaussians), frame, settings)
    assert engine.loss() == pytest.approx(loss, rel=1e-4)
    # After the first step the first moment is (1 - β₁) times the gradient.
    measured = engine.optimiser_state().first_moments / (1.0 - settings.adam.beta1)
    expected = columns(gradient)
    for start, end in ((0, 3), (3, 6), (6, 9), (9, 10), (10, expected.shape[1])):
        scale = np.abs(expected[:, start:end]).max()
        error = np.abs(measured[:, start:end] - expected[:, start:end])
        assert np.quantile(error, 0.99) < 1e-3 * scale
        assert error.max() < 2e-2 * scale


@pytest.mark.parametrize("size", [(29, 37), (11, 11), (12, 40), (64, 17), (10, 30), (1, 1)])
@pytest.mark.parametrize("shares", [1, 2, 5])
@pytest.mark.parametrize("masked", [False, True])
def test_losses_agree_at_every_size(size: tuple[int, int], shares: int, masked: bool) -> None:
    rng = np.random.default_rng(4)
    rendered = rng.uniform(size=(*size, 3)).astype(np.float32)
    photo = rng.integers(0, 256, (*size, 3)).astype(np.uint8)
    mask = rng.uniform(size=size) > 0.3 if masked else np.zeros((0, 0), np.bool_)
    settings = LossSettings("l1-dssim", 0.4)
    gradient, row_losses = np.empty((3, *size), np.float32), np.empty((3, size[0]), np.float32)
    planes = [np.ascontiguousarray(np.moveaxis(image, 2, 0)) for image in (rendered, photo)]
    photometric(planes[0], planes[1], mask, settings, shares, gradient, row_losses)
    loss, expected = photometric_loss(rendered.astype(np.float64), photo / 255.0, settings, mask if masked else None)
    assert row_losses.sum() == pytest.approx(loss, rel=1e-5)
    np.testing.assert_allclose(np.moveaxis(gradient, 0, 2), expected, atol=2e-4 * np.abs(expected).max())


def test_thirty_steps_agree(camera: Camera, make_gaussians: MakeGaussians) -> None:
    gaussians = make_gaussians(count=80, sh_degree=1, size=0.12)
    frame = photograph(camera)
    settings = StepSettings(RATES, LossSettings(), background=BACKGROUND)
    engine = CpuEngine()
    engine.set_views([frame])
    engine.upload(gaussians)
    scene, moments = Scene.of(gaussians), None
    for _ in range(30):
        engine.step(0, settings)
        loss, _, moments = reference_step(scene, frame, settings, moments)
    assert engine.loss() == pytest.approx(loss, rel=2e-3)
    result = engine.download()
    for name, tolerance in (("means", 2e-3), ("log_scales", 2e-2), ("opacity_logits", 2e-2)):
        assert np.quantile(np.abs(getattr(result, name) - getattr(scene, name)), 0.95) < tolerance


def test_steps_agree_where_gradients_are_as_small_as_epsilon(camera: Camera, make_gaussians: MakeGaussians) -> None:
    gaussians, frame = make_gaussians(count=40, sh_degree=0, size=0.2), photograph(camera)
    settings = StepSettings(RATES, LossSettings("l2"), AdamSettings(epsilon=1e-3), background=BACKGROUND)
    engine, scene = CpuEngine(), Scene.of(gaussians)
    engine.set_views([frame])
    engine.upload(gaussians)
    engine.step(0, settings)
    reference_step(scene, frame, settings)
    moved, expected = engine.download().means - gaussians.means, scene.means - gaussians.means
    assert 0.01 * RATES.means < np.median(np.abs(expected)) < 0.9 * RATES.means
    np.testing.assert_allclose(moved, expected, atol=0.01 * np.abs(expected).max())


def test_turns_by_large_angles_agree(camera: Camera, make_gaussians: MakeGaussians) -> None:
    """A first step is as long as the rate along each axis: 50 degrees in all."""
    gaussians, frame = make_gaussians(count=40, sh_degree=0, size=0.2), photograph(camera)
    settings = StepSettings(replace(RATES, rotations=0.5), LossSettings("l2"), background=BACKGROUND)
    engine, scene = CpuEngine(), Scene.of(gaussians)
    engine.set_views([frame])
    engine.upload(gaussians)
    engine.step(0, settings)
    reference_step(scene, frame, settings)
    error = np.abs(engine.download().quaternions - scene.quaternions).max(axis=1)
    assert np.quantile(error, 0.8) < 1e-3
    assert np.abs(np.sum(scene.quaternions * Scene.of(gaussians).quaternions, axis=1)).min() < 0.95
