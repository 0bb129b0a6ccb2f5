"""Quaternions of any length, as they are drawn."""

from __future__ import annotations

import numpy as np
import pytest

from pocketgs.geometry.camera import Camera, look_at
from pocketgs.geometry.quaternions import rotation_matrices
from pocketgs.scene.edits import rotated
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import EngineOptions
from pocketgs.splat.rendering import render
from scene.formats.scenes import covariances, random_scene


def with_quaternions(quaternions: list[list[float]]) -> Gaussians:
    scene = random_scene(len(quaternions), 1, extent=1.0)
    scene.log_scales[:] = [-1, -2, -3]
    scene.quaternions[:] = quaternions
    return scene


@pytest.mark.parametrize("length", [1e-45, 1e-30, 1e-16, 1e-3, 1.0, 7.0, 1e16, 1e30, 1.7e38])
def test_quaternions_of_any_length(length: float) -> None:
    found = with_quaternions([[length, -length, length, length]]).unit_quaternions
    np.testing.assert_allclose(found, [[0.5, -0.5, 0.5, 0.5]], atol=1e-6)
    assert found.dtype == np.float32


def test_quaternion_of_length_0_is_the_identity() -> None:
    scene = with_quaternions([[0, 0, 0, 0], [-0.0, 0, 0, -0.0], [np.nan, 0, 0, 1], [np.inf, 0, 0, 0]])
    np.testing.assert_array_equal(scene.unit_quaternions[:2], [[1, 0, 0, 0]] * 2)
    assert np.isnan(scene.unit_quaternions[2:]).any(axis=1).all()
    np.testing.assert_array_equal(rotation_matrices(scene.quaternions)[:2], [np.eye(3)] * 2)
    assert np.isnan(rotation_matrices(scene.quaternions)[2:]).any(axis=(1, 2)).all()


def test_quaternion_of_length_0_is_drawn_as_the_identity() -> None:
    pose = look_at(np.array([0.0, 0.5, -4.0]), np.zeros(3), np.array([0.0, -1.0, 0.0]))
    camera = Camera(64, 48, 60.0, 60.0, 32.0, 24.0, pose)
    zero, identity = (
        render(with_quaternions([[w, 0, 0, 0]] * 20), camera, engine=EngineOptions(engine="cpu")).image for w in (0, 1)
    )
    assert identity.std() > 0.05
    np.testing.assert_array_equal(zero, identity)


def test_quaternion_of_length_0_turns_with_the_scene() -> None:
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    found, expected = (rotated(with_quaternions([[w, 0, 0, 0]] * 3), turn) for w in (0, 1))
    np.testing.assert_allclose(covariances(found), covariances(expected), atol=1e-6)
