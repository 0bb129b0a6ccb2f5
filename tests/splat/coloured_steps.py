"""Training steps that learn colour transforms, shared by the tests of all engines, and their reference."""

from __future__ import annotations

import numpy as np
import pytest

from pocketgs.capture.capture import Frame
from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.colours import CHANGE, no_transforms, transforms_of
from pocketgs.splat.engine import Engine, OptimiserState
from pocketgs.splat.parameters import ParameterLayout
from pocketgs.splat.reference.colours import learn_transform, transformed, transformed_backward
from pocketgs.splat.reference.loss import photometric_loss
from pocketgs.splat.reference.project import project, project_backward
from pocketgs.splat.reference.rasterize import rasterize, rasterize_backward
from pocketgs.splat.reference.scene import Scene, SceneGradient
from pocketgs.splat.settings import ColourSettings, StepSettings
from splat.training_step import BACKGROUND, RATES, columns, photograph

LEARNING = ColourSettings(rate=0.02, weight=0.01)
COLOURED = StepSettings(RATES, background=BACKGROUND, colours=LEARNING)


def random_table(photographs: int) -> np.ndarray:
    """(V, COLUMNS) float32 random transforms with a mean of zero."""
    rng = np.random.default_rng(5)
    table = no_transforms(photographs)
    table[:, CHANGE] = rng.normal(0, 0.1, (photographs, 12))
    table[:, CHANGE] -= table[:, CHANGE].mean(axis=0)
    return table


def state_with(gaussians: Gaussians, table: np.ndarray) -> OptimiserState:
    """Adam's initial state, with the given colour transforms."""
    zeros = np.zeros((len(gaussians), ParameterLayout(gaussians.sh.shape[1]).columns), np.float32)
    return OptimiserState(zeros, zeros.copy(), 0, colours=table)


def frames_of(camera: Camera) -> list[Frame]:
    """Three photographs of noise."""
    return [photograph(camera, seed=seed) for seed in range(3)]


def reference_step_with_colours(
    gaussians: Gaussians, frame: Frame, view: int, table: np.ndarray
) -> tuple[float, SceneGradient, np.ndarray]:
    """Loss and gradient of the reference's step on a view, and the (V, COLUMNS) float64 table after it."""
    scene, camera, after = Scene.of(gaussians), frame.camera, table.astype(np.float64)
    transform = transforms_of(table)[view]
    projection = project(scene, camera)
    raster = rasterize(projection, camera, np.array(BACKGROUND))
    compared = transformed(raster.image, transform)
    loss, d_compared = photometric_loss(compared, frame.image / 255.0, COLOURED.loss, frame.mask)
    d_image, d_transform = transformed_backward(raster.image, transform, d_compared)
    gradient = project_backward(scene, camera, projection, rasterize_backward(projection, camera, raster, d_image))
    learn_transform(after, view, d_transform, LEARNING, COLOURED.adam)
    return loss, gradient, after


def colours_after_a_checked_step(engine: Engine, gaussians: Gaussians, frame: Frame) -> np.ndarray:
    """Take one step from random transforms, compare it with the reference, and return the table of transforms."""
    table = random_table(3)
    engine.set_views([frame] * 3)
    engine.upload(gaussians, state_with(gaussians, table))
    engine.step(1, COLOURED)
    loss, gradient, expected = reference_step_with_colours(gaussians, frame, 1, table)
    assert engine.loss() == pytest.approx(loss, rel=1e-4)
    state = engine.optimiser_state()
    measured = state.first_moments / (1.0 - COLOURED.adam.beta1)
    error = np.abs(measured - columns(gradient))
    assert np.quantile(error, 0.99) < 1e-3 * np.abs(columns(gradient)).max()
    assert state.colours is not None
    np.testing.assert_allclose(state.colours, expected, rtol=2e-3, atol=2e-6)
    return state.colours
