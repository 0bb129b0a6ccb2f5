"""Renderers of sort-free scenes, with the interface of the engines."""

from __future__ import annotations

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.scene.background import BLACK, Background
from pocketgs.sort_free.scene import SortFreeScene
from pocketgs.splat.choose_engine import chosen_engine
from pocketgs.splat.engine import EngineOptions, Renderer, Rendering


def drawing_of(scene: SortFreeScene, options: EngineOptions) -> Renderer:
    """A renderer of the scene on the chosen engine.

    Raises:
        PocketGSError: the engine is not available here.
    """
    if chosen_engine(options) == "cpu":
        return SortFreeDrawing(scene, options.threads)
    from pocketgs.splat.webgpu.weighted import WeightedDrawing

    numbers = dict(zip(scene.form.numbers, np.exp(scene.log_shared), strict=True))
    given = scene.gaussians, scene.form.name, scene.unit, numbers, scene.visibility_sh
    return WeightedDrawing(*given, options.gpu, options.max_memory)


class SortFreeDrawing:
    """Draws on the CPU; see `pocketgs.splat.engine.Renderer`.

    Args:
        scene: to draw.
        threads: number of threads, or None for one per core.
    """

    def __init__(self, scene: SortFreeScene, threads: int | None = None) -> None:
        # Imported here because Numba is slow to load.
        from pocketgs.sort_free.renderer import SortFreeRenderer

        self._scene = scene
        self._renderer = SortFreeRenderer("cpu", threads)

    def render(self, camera: Camera, background: Background = BLACK, depth: bool = False) -> Rendering:
        """Render the scene."""
        image = self._renderer.forward(self._scene, camera, background, depth=depth)
        return Rendering(image.rgb, image.alpha, image.depth)
