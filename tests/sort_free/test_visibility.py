"""The fit of what cameras see."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pocketgs.geometry.camera import Camera, look_at
from pocketgs.scene.gaussians import Gaussians
from pocketgs.sort_free import visibility
from pocketgs.splat.rasterizer import Rasterizer


def test_fitting_a_few_gaussians_at_a_time_gives_the_same_bits(
    monkeypatch: pytest.MonkeyPatch, camera: Camera, make_gaussians: Callable[..., Gaussians]
) -> None:
    other = replace(
        camera, world_to_camera=look_at(np.array([3.0, 0.0, -3.0]), np.zeros(3), np.array([0.0, -1.0, 0.0]))
    )
    sorted_, summed = Rasterizer("cpu"), Rasterizer("cpu", compositor="sum")

    def fitted() -> np.ndarray:
        return visibility.fitted_views(make_gaussians(count=40), [camera, other], 2, sorted_, summed)

    at_once = fitted()
    monkeypatch.setattr(visibility, "BLOCK", 7)
    assert fitted().tobytes() == at_once.tobytes()
    assert np.ptp(at_once[:, 0]) > 1.0
