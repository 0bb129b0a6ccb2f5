"""Drawing without sorting in compute shaders: weights and colours are made on the GPU, view by view."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.gpu.adapters import choose_adapter
from pocketgs.gpu.buffer_sizes import check_buffers
from pocketgs.gpu.device import shared_device
from pocketgs.gpu.executor import Executor
from pocketgs.scene.background import BLACK, Background
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.checks import checked_scene
from pocketgs.splat.engine import EngineOptions, Rendering
from pocketgs.splat.near_plane import near_plane
from pocketgs.splat.webgpu.drawing import draw_once, make_room_for, rendered
from pocketgs.splat.webgpu.lenses import LENSES, lens_symbols
from pocketgs.splat.webgpu.memory import GROWTH, INTERSECTIONS_PER_GAUSSIAN, MIN_INTERSECTIONS
from pocketgs.splat.webgpu.passes import describe_rendering
from pocketgs.splat.webgpu.scene_columns import to_columns, transposed
from pocketgs.splat.webgpu.variant import Variant, Weights


class WeightedDrawing:
    """Draws a scene whose Gaussians have weights; see `pocketgs.splat.engine.Renderer`.

    Args:
        gaussians: the scene.
        weights: what Gaussians are weighted by.
        unit: length that distances are measured in, in scene units.
        numbers: those of the struct `Weighting` in `common/weights.wgsl` that the weights are made with, by name.
        views: (N, K) spherical harmonics of what a weight depends on, K = 0, 1, 4, 9 or 16.
        gpu: part of the name of the GPU to use, or None for the best.
        max_memory: megabytes of GPU memory that buffers may take.

    Raises:
        PocketGSError: there is no such device, or it lacks something.
    """

    def __init__(
        self,
        gaussians: Gaussians,
        weights: Weights,
        unit: float,
        numbers: Mapping[str, float],
        views: np.ndarray,
        gpu: str | None = None,
        max_memory: int = EngineOptions.max_memory,
    ) -> None:
        adapter = choose_adapter(gpu)
        variant = Variant(subgroups="subgroup" in adapter.features, weights=weights, lenses=LENSES)
        device = shared_device(adapter, variant.features)
        self._executor = Executor(device, describe_rendering(variant))
        self._largest = adapter.largest_buffer
        self._max_memory = max_memory
        scene = checked_scene(gaussians)
        count = len(scene)
        self._near = near_plane(scene.means)
        self._counts = {
            "gaussians": count,
            "capacity": count,
            "coefficients": scene.sh.shape[1],
            "view_coefficients": views.shape[1],
        }
        self._intersections = max(MIN_INTERSECTIONS, INTERSECTIONS_PER_GAUSSIAN * count)
        shape, sh = to_columns(scene)
        self._columns = {"shape": shape, "sh": sh, "views": transposed(views)}
        absent = dict.fromkeys(self._executor.description.uniforms["weighting"].fields, 0.0)
        self._weighting = {**absent, **numbers, "unit": unit, "view_coefficients": views.shape[1]}
        self._is_written = False

    def render(self, camera: Camera, background: Background = BLACK, depth: bool = False) -> Rendering:
        """Render the scene.

        Raises:
            PocketGSError: it does not fit in the GPU's memory.
        """
        return rendered(self._draw, camera, background, depth)

    def _draw(self, sequence: str, camera: Camera, background: Background) -> np.ndarray:
        """(H, W, 4) float32: colour and how much of the background shows."""
        wanted, least = self._intersections, MIN_INTERSECTIONS
        while True:
            symbols = make_room_for(partial(self._make_room, camera), wanted, least)
            image, needed = draw_once(self._executor, sequence, camera, background, self._near, symbols)
            if not needed:
                return image
            wanted, least = int(needed * GROWTH), needed
            self._executor.write("status", np.zeros(3, np.uint32))

    def _make_room(self, camera: Camera, intersections: int) -> dict[str, int]:
        """Make the buffers for an image, and write the scene to them the first time. What does not fit is refused
        before anything is changed.
        """
        description = self._executor.description
        given = {"width": camera.width, "height": camera.height, "replay_depth": 0, **lens_symbols(camera)}
        symbols = description.symbols({**self._counts, **given, "intersections": intersections})
        sizes = description.sizes(symbols, description.buffers_of(description.sequences))
        check_buffers(sizes, self._largest, "fewer Gaussians or smaller images")
        total = sum(sizes.values()) / 1e6
        if total > self._max_memory:
            expected = "expected a larger --max-memory, or smaller images (--downscale)"
            raise PocketGSError(
                f"this would take {total:.0f} MB of GPU memory, the limit is {self._max_memory} MB: {expected}"
            )
        self._executor.reserve(sizes)
        if not self._is_written:
            for name, values in self._columns.items():
                self._executor.write(name, values)
            self._executor.write_uniform("weighting", self._weighting)
            self._executor.clear("cluster_bounds")
            self._is_written = True
        self._intersections = intersections
        return symbols
