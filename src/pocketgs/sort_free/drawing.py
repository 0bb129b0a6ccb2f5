"""A sort-free scene that is drawn as the engines draw theirs."""

from __future__ import annotations

from pocketgs.geometry.camera import Camera
from pocketgs.sort_free.renderer import SortFreeRenderer
from pocketgs.sort_free.scene import SortFreeScene
from pocketgs.splat.engine import EngineOptions, Rendering, chosen_engine


class SortFreeDrawing:
    """See `pocketgs.splat.engine.Renderer`.

    Args:
        scene: to draw.
        options: of the engine.

    Raises:
        PocketGSError: the engine is not available here.
    """

    def __init__(self, scene: SortFreeScene, options: EngineOptions) -> None:
        self._scene = scene
        self._renderer = SortFreeRenderer(chosen_engine(options), options.threads, options.gpu)

    def render(
        self, camera: Camera, background: tuple[float, float, float] = (0.0, 0.0, 0.0), depth: bool = False
    ) -> Rendering:
        """Render the scene."""
        image = self._renderer.forward(self._scene, camera, background, depth=depth)
        return Rendering(image.rgb, image.alpha, image.depth)
