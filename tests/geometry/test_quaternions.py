"""Quaternions of any length: one rule for all that turn."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pocketgs import Camera, Gaussians, Rasterizer
from pocketgs.geometry.quaternions import rotation_matrices, unit

LENGTHS = (1e-44, 1e-30, 1e-25, 1e-15, 1.0, 1e15, 1e25, 3e38)
"""From near the smallest to near the largest of float32, whose squares are 0 and infinity."""


def random_quaternions(count: int = 20) -> np.ndarray:
    return unit(np.random.default_rng(3).normal(size=(count, 4)))


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_rotation_does_not_depend_on_the_length(length: float, dtype: Any) -> None:
    quaternions = (random_quaternions() * length).astype(dtype)
    # Of the shortest, a bit or two are left.
    exact = quaternions.astype(np.float64)
    exact /= np.linalg.norm(exact / length, axis=1, keepdims=True) * length
    found = rotation_matrices(quaternions)
    assert found.dtype == dtype
    np.testing.assert_allclose(found, rotation_matrices(exact), atol=1e-6)
    np.testing.assert_allclose(found @ np.swapaxes(found, 1, 2), np.broadcast_to(np.eye(3), (20, 3, 3)), atol=1e-6)


def test_no_rotation_and_no_number() -> None:
    quaternions = np.array([[0, 0, 0, 0], [np.nan, 0, 0, 1], [np.inf, 0, 0, 1], [0, 0, 0, -2]], np.float32)
    np.testing.assert_array_equal(unit(quaternions)[[0, 3]], [[1, 0, 0, 0], [0, 0, 0, -1]])
    assert np.isnan(unit(quaternions)[1:3]).all()
    matrices = rotation_matrices(quaternions)
    np.testing.assert_array_equal(matrices[0], np.eye(3))
    assert np.isnan(matrices[1:3]).any(axis=(1, 2)).all()


@pytest.mark.parametrize("length", [1e-25, 1e25])
def test_colours_and_normals_turn_alike(length: float) -> None:
    rng = np.random.default_rng(0)
    count = 30
    scene = Gaussians(
        rng.uniform([-1, -1, 1.8], [1, 1, 2.5], (count, 3)),
        rng.normal(-2.5, 0.3, (count, 3)),
        random_quaternions(count),
        rng.normal(size=count),
        rng.normal(size=(count, 1, 3)),
    )
    scaled = Gaussians(
        scene.means, scene.log_scales, scene.quaternions * np.float32(length), scene.opacity_logits, scene.sh
    )
    camera = Camera(64, 48, 60.0, 60.0, 32.0, 24.0, np.eye(4))
    usual, other = (Rasterizer("cpu").forward(each, camera, ("rgb", "normals")) for each in (scene, scaled))
    np.testing.assert_allclose(other.rgb, usual.rgb, atol=1e-5)
    np.testing.assert_allclose(other.normals, usual.normals, atol=1e-5)
