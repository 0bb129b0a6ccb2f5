"""Adam with `seen_only`: checks shared by the tests of all engines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import PARAMETERS, Gaussians
from pocketgs.splat.engine import Engine
from pocketgs.splat.reference.scene import Scene
from pocketgs.splat.settings import AdamSettings, LossSettings, StepSettings
from splat.training_step import BACKGROUND, RATES, begin, camera_in_front, columns, photograph, reference_step

SETTINGS = StepSettings(RATES, LossSettings(), AdamSettings(beta2=0.95, seen_only=True), BACKGROUND)
ASIDE = 12.0
COUNT = 60


def two_groups(make_gaussians: Callable[..., Gaussians]) -> tuple[Gaussians, np.ndarray, list[Frame]]:
    """Gaussians in two groups, the mask of those far to the side, and a photograph of each group."""
    gaussians = make_gaussians(count=COUNT, sh_degree=1, size=0.15)
    gaussians.opacity_logits += 2.0
    aside = np.arange(COUNT) % 3 == 0
    gaussians.means[aside, 0] += ASIDE
    camera = camera_in_front(48, 40, 20.0)
    pose = camera.world_to_camera.copy()
    pose[0, 3] -= ASIDE
    frames = [photograph(camera), photograph(moved(camera, pose), seed=5)]
    return gaussians, aside, frames


def moved(camera: Camera, pose: np.ndarray) -> Camera:
    return replace(camera, world_to_camera=pose)


def rows_that_differ(one: Gaussians, other: Gaussians) -> np.ndarray:
    """(N,) bool: whether any bit of any parameter differs."""
    differ = np.zeros(len(one), bool)
    for name in PARAMETERS:
        first, second = (getattr(scene, name).reshape(len(one), -1) for scene in (one, other))
        differ |= np.any(first != second, axis=1)
    return differ


def assert_what_is_not_seen_stays(engine: Engine, make_gaussians: Callable[..., Gaussians]) -> None:
    """Parameters and moments of Gaussians outside the view stay unchanged; once visible again, training continues."""
    gaussians, aside, frames = two_groups(make_gaussians)
    begin(engine, gaussians, frames)
    start = engine.download()
    for _ in range(3):
        engine.step(0, SETTINGS)
    state, here = engine.optimiser_state(), engine.download()
    np.testing.assert_array_equal(rows_that_differ(here, start), ~aside)
    np.testing.assert_array_equal(state.first_moments.any(axis=1), ~aside)
    np.testing.assert_array_equal(state.second_moments.any(axis=1), ~aside)
    engine.step(1, SETTINGS)
    after, there = engine.optimiser_state(), engine.download()
    np.testing.assert_array_equal(rows_that_differ(there, here), aside)
    for name in ("first_moments", "second_moments"):
        before, now = getattr(state, name), getattr(after, name)
        assert before[~aside].tobytes() == now[~aside].tobytes()
        assert now[aside].any(axis=1).all()
    engine.step(0, SETTINGS)
    np.testing.assert_array_equal(rows_that_differ(engine.download(), there), ~aside)


def assert_what_is_not_seen_drifts_on_otherwise(engine: Engine, make_gaussians: Callable[..., Gaussians]) -> None:
    """The same steps with plain Adam: Gaussians outside the view keep moving."""
    gaussians, _, frames = two_groups(make_gaussians)
    begin(engine, gaussians, frames)
    settings = replace(SETTINGS, adam=replace(SETTINGS.adam, seen_only=False))
    engine.step(0, settings)
    here = engine.download()
    engine.step(1, settings)
    assert rows_that_differ(engine.download(), here).all()


def assert_steps_agree_with_the_reference(
    engine: Engine, make_gaussians: Callable[..., Gaussians], tolerance: float
) -> None:
    """Moments and parameters agree after steps on both views in turn."""
    gaussians, aside, frames = two_groups(make_gaussians)
    scene, moments = Scene.of(gaussians), None
    begin(engine, gaussians, frames)
    for view in (0, 0, 1, 0, 1):
        engine.step(view, SETTINGS)
        _, gradient, moments = reference_step(scene, frames[view], SETTINGS, moments)
        np.testing.assert_array_equal(columns(gradient).any(axis=1), aside if view else ~aside)
    assert moments is not None
    state, result = engine.optimiser_state(), engine.download()
    for measured, expected in (
        (state.first_moments, columns(moments.first)),
        (state.second_moments, columns(moments.second)),
    ):
        for start, end in ((0, 3), (3, 6), (6, 9), (9, 10), (10, expected.shape[1])):
            for group in (aside, ~aside):
                scale = np.abs(expected[group, start:end]).max()
                error = np.abs(measured[group, start:end] - expected[group, start:end])
                assert np.quantile(error, 0.95) < tolerance * scale
    for name, most in (("means", 2e-3), ("log_scales", 5e-3), ("opacity_logits", 1e-2)):
        assert np.quantile(np.abs(getattr(result, name) - getattr(scene, name)), 0.95) < most * max(1, 100 * tolerance)
