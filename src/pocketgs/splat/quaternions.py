"""Conversion of rotation gradients from tangent spaces to quaternions."""

from __future__ import annotations

import numpy as np


def quaternion_gradient(quaternions: np.ndarray, d_rotations: np.ndarray) -> np.ndarray:
    """(N, 4) gradient with respect to quaternions of any length, from that in their tangent spaces.

    A unit quaternion moves by ½ q ⊗ (0, δ), and changes of its length have no effect. So the gradient is 2 q ⊗ (0, d),
    divided by the length twice: once to normalise q, once since normalisation scales a step. That of a zero quaternion,
    which is drawn as the identity, is 0.

    Args:
        quaternions: (N, 4) w, x, y, z.
        d_rotations: (N, 3) with respect to δ in q ← q ⊗ exp(½δ); where it is 0, the result is 0.
    """
    whole = quaternions.astype(np.float64)  # float32 does not hold the squares of very short and long ones
    w, v = whole[:, :1], whole[:, 1:]
    with np.errstate(all="ignore"):
        scalar = -np.sum(v * d_rotations, axis=1, keepdims=True)
        product = np.concatenate([scalar, w * d_rotations + np.cross(v, d_rotations)], axis=1)
        squares = np.sum(whole**2, axis=1, keepdims=True)
        gradient = 2.0 * product / np.where(squares == 0, 1.0, squares)
    return np.where(np.any(d_rotations != 0.0, axis=1, keepdims=True), gradient, 0.0).astype(d_rotations.dtype)
