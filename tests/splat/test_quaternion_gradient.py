"""Rotation gradients of quaternions that have no direction."""

from __future__ import annotations

import numpy as np
import pytest

from pocketgs.splat.quaternions import quaternion_gradient


def test_a_zero_quaternion_has_no_gradient() -> None:
    quaternions = np.array([[0.0, 0.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0]])
    gradient = quaternion_gradient(quaternions, np.array([[1.0, 2.0, 3.0], [1.0, 2.0, 3.0]]))
    assert gradient.tolist() == [[0.0, 0.0, 0.0, 0.0], [0.0, 1.0, 2.0, 3.0]]


@pytest.mark.parametrize("length", [1e-22, 1e20])
def test_lengths_whose_squares_float32_does_not_hold(length: float) -> None:
    direction = np.array([[0.5, -0.5, 0.5, 0.5]])
    gradient = quaternion_gradient(np.float32(length * direction), np.float32([[1.0, 2.0, 3.0]]))
    assert gradient.dtype == np.float32
    expected = quaternion_gradient(direction, np.array([[1.0, 2.0, 3.0]]))
    np.testing.assert_allclose(length * gradient.astype(np.float64), expected, rtol=1e-6)
