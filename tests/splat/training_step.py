"""Inputs of a training step, shared by the tests of all engines, and the same step in the reference."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from hypothesis import strategies as st

from pocketgs.capture.capture import Frame
from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import PARAMETERS, Gaussians
from pocketgs.splat.engine import Engine
from pocketgs.splat.reference.adam import Moments, adam
from pocketgs.splat.reference.loss import photometric_loss, regularise
from pocketgs.splat.reference.project import project, project_backward
from pocketgs.splat.reference.rasterize import rasterize, rasterize_backward
from pocketgs.splat.reference.scene import Scene, SceneGradient
from pocketgs.splat.settings import LearningRates, StepSettings

BACKGROUND = (0.2, 0.5, 0.8)
RATES = LearningRates(2e-3, 5e-3, 4e-3, 1e-2, 1e-2, 1e-3)

AnyEngine = TypeVar("AnyEngine", bound=Engine)


def begin(engine: AnyEngine, gaussians: Gaussians, frames: Sequence[Frame] = ()) -> AnyEngine:
    """Upload a scene to the engine and, for training, the photographs."""
    if frames:
        engine.set_views(frames)
    engine.upload(gaussians)
    return engine


def camera_in_front(width: int, height: int, focal: float, distance: float = 4.0) -> Camera:
    """A camera that looks along z at the origin, with a centred principal point."""
    pose = np.eye(4)
    pose[2, 3] = distance
    return Camera(width, height, focal, focal, width / 2, height / 2, pose)


def photograph(camera: Camera, masked: bool = False, seed: int = 11) -> Frame:
    """A photograph of noise, with a quarter of its pixels masked."""
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 256, (camera.height, camera.width, 3)).astype(np.uint8)
    mask = rng.uniform(size=image.shape[:2]) > 0.25 if masked else None
    return Frame("photo", camera, image, mask=mask)


HOSTILE = st.sampled_from([0.0, 1.0, -1.0, 1e-30, 1e10, -1e10, 1e30, -1e30, np.nan, np.inf, -np.inf, 88.0, -100.0])
"""Values that diverged parameters may have."""

EDITS = st.lists(st.tuples(st.integers(0, 200), HOSTILE), min_size=1, max_size=40)


def with_hostile_numbers(edits: list[tuple[int, float]]) -> Gaussians:
    """Twenty Gaussians with some hostile parameters."""
    rng = np.random.default_rng(8)
    parameters = [
        rng.normal(0, 0.5, (20, 3)),
        rng.normal(-2, 0.5, (20, 3)),
        rng.normal(0, 1, (20, 4)),
        rng.normal(0, 1, 20),
        rng.normal(0, 0.3, (20, 4, 3)),
    ]
    for place, value in edits:
        array = parameters[place % 5].reshape(-1)
        array[(place * 7919) % array.size] = value
    return Gaussians(*(array.astype(np.float32) for array in parameters))


def of_every_size(seed: int) -> Gaussians:
    """Fifteen Gaussians, from points to larger than the image, from faint to opaque."""
    rng = np.random.default_rng(seed)
    count = 15
    return Gaussians(
        rng.uniform(-1.5, 1.5, (count, 3)),
        rng.uniform(-5, 0.5, (count, 3)),
        rng.normal(size=(count, 4)),
        rng.uniform(-5, 5, count),
        np.zeros((count, 1, 3)),
    )


def sheets(opacities: np.ndarray) -> Gaussians:
    """One behind the other, each of the same opacity all over the image."""
    count = len(opacities)
    means = np.column_stack([np.zeros((count, 2)), np.linspace(0.0, 0.1, count)])
    logits = np.log(opacities / (1.0 - opacities))
    return Gaussians(
        means, np.full((count, 3), 5.0), np.tile([1.0, 0, 0, 0], (count, 1)), logits, np.zeros((count, 1, 3))
    )


def a_million_off_screen() -> Gaussians:
    """Gaussians far to the side of the view of `camera_in_front`."""
    rng = np.random.default_rng(1)
    count = 1_000_000
    means = rng.normal(size=(count, 3)).astype(np.float32)
    means[:, 0] += 1000.0
    return Gaussians(
        means, np.full((count, 3), -5.0), np.eye(4)[np.zeros(count, int)], np.zeros(count), np.zeros((count, 1, 3))
    )


def reference_step(
    scene: Scene, frame: Frame, settings: StepSettings, moments: Moments | None = None
) -> tuple[float, SceneGradient, Moments]:
    """Train `scene` on one view, in place; returns the loss, its gradient and the new moments."""
    camera, background = frame.camera, np.array(settings.background)
    projection = project(scene, camera)
    raster = rasterize(projection, camera, background)
    loss, d_image = photometric_loss(raster.image, frame.image / 255.0, settings.loss, frame.mask)
    gradient = project_backward(scene, camera, projection, rasterize_backward(projection, camera, raster, d_image))
    loss += regularise(scene, settings.loss, gradient)
    moments = moments or Moments.zeros_for(gradient)
    adam(scene, gradient, moments, settings.rates, settings.adam)
    return loss, gradient, moments


def columns(gradient: SceneGradient) -> np.ndarray:
    """(N, 10 + 3 K): the gradient in the columns of `OptimiserState`."""
    count = len(gradient.means)
    parts = [gradient.means, gradient.log_scales, gradient.rotations, gradient.opacity_logits[:, None], gradient.sh]
    return np.concatenate([part.reshape(count, -1) for part in parts], axis=1)


def assert_identical(one: Gaussians, other: Gaussians) -> None:
    """Check that two scenes are equal bit for bit."""
    for name in PARAMETERS:
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name
