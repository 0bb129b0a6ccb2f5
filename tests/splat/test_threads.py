"""Threads that share a rasterizer: each gets its own image."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numba
import numpy as np
import pytest

from pocketgs import Rasterizer
from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import Gaussians


def test_threads_may_share_a_rasterizer(camera: Camera, make_gaussians: Callable[..., Gaussians], engine: str) -> None:
    rasterizer = Rasterizer(engine)  # type: ignore[arg-type]
    scenes = [make_gaussians(count=100, seed=seed) for seed in (0, 1)]

    def drawn(scene: Gaussians) -> list[np.ndarray]:
        raster = rasterizer.forward(scene, camera, ("rgb", "median_depth"))
        gradient = rasterizer.backward(raster, rgb=np.ones_like(raster.rgb))
        (contributions,) = rasterizer.contributions(scene, [camera])
        return [raster.rgb, raster.median_depth, gradient.means, contributions.summed]

    expected = [drawn(scene) for scene in scenes]
    if engine == "cpu" and numba.threading_layer() == "workqueue":
        pytest.skip("Numba has neither OpenMP nor TBB: it takes no kernels from two threads")
    with ThreadPoolExecutor(2) as executor:
        found = list(executor.map(drawn, 5 * scenes))
    for place, results in enumerate(found):
        for result, own in zip(results, expected[place % 2], strict=True):
            np.testing.assert_array_equal(result, own)
