"""Rendering without training."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import EngineOptions, Rendering, create_engine

BLACK = (0.0, 0.0, 0.0)


def render(
    scene: Gaussians,
    camera: Camera,
    background: tuple[float, float, float] = BLACK,
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
    background: tuple[float, float, float] = BLACK,
    *,
    depth: bool = False,
    engine: EngineOptions | None = None,
) -> Iterator[Rendering]:
    """Render several views; see `render`."""
    renderer = create_engine(engine)
    renderer.upload(scene)
    for camera in cameras:
        yield renderer.render(camera, background, depth)
