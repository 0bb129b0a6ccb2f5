"""The fit of what cameras see."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pocketgs.geometry.camera import Camera, look_at
from pocketgs.scene.gaussians import SH_DC, Gaussians
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
        return visibility.fitted_visibility(make_gaussians(count=40), [camera, other], 2, sorted_, summed)

    at_once = fitted()
    monkeypatch.setattr(visibility, "BLOCK", 7)
    assert fitted().tobytes() == at_once.tobytes()
    assert np.ptp(at_once[:, 0]) > 1.0


def test_cameras_that_disagree_count_by_what_they_see() -> None:
    """Three look at the same two centres: of the first one sees nothing, and the second is all but hidden from one."""
    centre = np.zeros(3)
    means = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 2.0]])
    shares = np.array([[0.9, 0.5], [0.2, 0.0], [0.7, 0.8]])
    covered = np.array([[4.0, 9.0], [16.0, 1.0], [0.0, 1.0]])
    looks = [(centre, *pair) for pair in zip(shares, covered, strict=True)]
    fitted = visibility._fitted(means, looks, 1)[:, 0] * SH_DC
    # The roots of what is covered, less where it is hidden: 2, 4 and 0, and 3, 1 and 1, before that.
    hidden = 0.05 + np.sqrt(shares)
    first = np.average(np.log([0.9, 0.2]), weights=hidden[:2, 0] * [2.0, 4.0])
    second = np.average(np.log([0.5, visibility.LEAST_VISIBLE, 0.8]), weights=hidden[:, 1] * [3.0, 1.0, 1.0])
    np.testing.assert_allclose(fitted, [first, second], rtol=1e-4)
