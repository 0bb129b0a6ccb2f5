"""Rendering a scene without training it."""

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
    """Render one view; for many, `render_all` uploads the scene once.

    Args:
        scene: what to show.
        camera: from where.
        background: RGB in [0, 1] behind the scene.
        depth: whether to add the expected depth.
        engine: what renders, and how; the best engine of this device if None.
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
    """Render views one after the other; see `render`."""
    renderer = create_engine(engine)
    renderer.upload(scene)
    for camera in cameras:
        yield renderer.render(camera, background, depth)
