"""Renders scenes from outside training: views of cameras, and of frames to be compared with photographs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.geometry.camera import Camera
from pocketgs.scene.background import BLACK, Background
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.choose_engine import create_engine
from pocketgs.splat.engine import EngineOptions, Renderer, Rendering


def render(
    scene: Gaussians,
    camera: Camera,
    background: Background = BLACK,
    *,
    depth: bool = False,
    engine: EngineOptions | None = None,
) -> Rendering:
    """Render one view; for several, `render_all` uploads the scene only once.

    Args:
        scene: to render.
        camera: of the view.
        background: RGB in [0, 1].
        depth: whether to render expected depth too.
        engine: options of the engine; None for the best engine of this device.
    """
    return next(render_all(scene, [camera], background, depth=depth, engine=engine))


def render_all(
    scene: Gaussians,
    cameras: Iterable[Camera],
    background: Background = BLACK,
    *,
    depth: bool = False,
    engine: EngineOptions | None = None,
) -> Iterator[Rendering]:
    """Render several views; see `render`."""
    renderer = create_engine(engine)
    renderer.upload(scene)
    for camera in cameras:
        yield renderer.render(camera, background, depth)


def render_frame(renderer: Renderer, frame: Frame, background: Background) -> np.ndarray:
    """Render a frame's view to (H, W, 3) float32, clipped to [0, 1] as on a screen.

    Args:
        renderer: with the scene.
        frame: whose camera renders; its photograph is not read.
        background: RGB in [0, 1].
    """
    return np.clip(renderer.render(frame.camera, background).image, 0.0, 1.0)
