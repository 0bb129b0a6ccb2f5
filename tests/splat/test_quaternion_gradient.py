"""Rotation gradients of quaternions that have no direction."""

from __future__ import annotations

import numpy as np

from pocketgs.splat.quaternions import quaternion_gradient


def test_a_zero_quaternion_has_no_gradient() -> None:
    quaternions = np.array([[0.0, 0.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0]])
    gradient = quaternion_gradient(quaternions, np.array([[1.0, 2.0, 3.0], [1.0, 2.0, 3.0]]))
    assert gradient.tolist() == [[0.0, 0.0, 0.0, 0.0], [0.0, 1.0, 2.0, 3.0]]
