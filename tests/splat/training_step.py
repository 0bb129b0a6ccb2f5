"""What the tests of all engines feed a training step, and the same step in the reference."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from pocketgs.camera import Camera
from pocketgs.capture.capture import Frame
from pocketgs.gaussians import PARAMETERS, Gaussians
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
    """The engine, with a scene and, if it is to train, the photographs."""
    if frames:
        engine.set_views(frames)
    engine.upload(gaussians)
    return engine


def camera_in_front(width: int, height: int, focal: float, distance: float = 4.0) -> Camera:
    """A camera that looks along z at the origin, the principal point in the middle."""
    pose = np.eye(4)
    pose[2, 3] = distance
    return Camera(width, height, focal, focal, width / 2, height / 2, pose)


def photograph(camera: Camera, masked: bool = False, seed: int = 11) -> Frame:
    """Noise in place of a photograph; the mask leaves out a quarter of its pixels."""
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 256, (camera.height, camera.width, 3)).astype(np.uint8)
    mask = rng.uniform(size=image.shape[:2]) > 0.25 if masked else None
    return Frame("photo", camera, image, mask=mask)


def reference_step(
    scene: Scene, frame: Frame, settings: StepSettings, moments: Moments | None = None
) -> tuple[float, SceneGradient, Moments]:
    """Train `scene` on one view, in place; returns the loss, its gradient and the moments to go on with."""
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
    """Two scenes are the same in every bit."""
    for name in PARAMETERS:
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name
