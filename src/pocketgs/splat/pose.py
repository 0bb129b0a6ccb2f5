"""The gradient with respect to the camera's pose, derived from that with respect to the Gaussians.

Moving the camera is equivalent to moving the scene the other way, so the gradient is a sum over the Gaussians'
positions and rotations. Only view-dependent colours break the equivalence, since harmonics do not rotate with a
Gaussian.
"""

from __future__ import annotations

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import SH_DC
from pocketgs.scene.spherical_harmonics import basis_gradient


def pose_gradient(
    camera: Camera,
    means: np.ndarray,
    axes: np.ndarray,
    sh: np.ndarray,
    d_means: np.ndarray,
    d_rotations: np.ndarray,
    d_sh: np.ndarray,
) -> np.ndarray:
    """Gradient with respect to ξ = (τ, ω) at 0, where world_to_camera becomes exp(ξ) world_to_camera.

    Args:
        camera: whose pose changes.
        means: (V, 3) of the visible Gaussians, as all arguments below.
        axes: (V, 3, 3) rotations from the Gaussians' axes to the world's.
        sh: (V, K, 3); K may be 0.
        d_means: (V, 3) gradient with respect to the means.
        d_rotations: (V, 3) gradient with respect to the rotations, in their tangent spaces.
        d_sh: (V, K, 3) gradient with respect to the coefficients.

    Returns:
        (6,) float64: τ, a shift along the camera's axes, then ω, a rotation vector about them.
    """
    rotation = camera.world_to_camera[:3, :3]
    offsets = means - camera.centre
    shift = rotation @ d_means.sum(axis=0, dtype=np.float64)
    # Rotating the camera about its own centre does not change viewing directions.
    d_positions = d_means - _through_directions(offsets, sh, d_sh)
    turn = np.cross(offsets, d_positions) + np.einsum("nij,nj->ni", axes, d_rotations)
    return np.concatenate([shift, rotation @ turn.sum(axis=0, dtype=np.float64)])


def _through_directions(offsets: np.ndarray, sh: np.ndarray, d_sh: np.ndarray) -> np.ndarray:
    """(V, 3) gradient with respect to the means through the viewing directions of colours."""
    if sh.shape[1] < 2:
        return np.zeros_like(offsets)
    distances = np.linalg.norm(offsets, axis=1, keepdims=True)
    directions = offsets / distances
    d_colours = d_sh[:, 0] / SH_DC
    d_directions = np.einsum("nki,nkc,nc->ni", basis_gradient(directions, sh.shape[1]), sh, d_colours)
    along = np.sum(directions * d_directions, axis=1, keepdims=True)
    return np.asarray((d_directions - along * directions) / distances)


def matrix_gradient(camera: Camera, pose: np.ndarray) -> np.ndarray:
    """(3, 4) gradient with respect to world_to_camera's upper rows, from the (6,) gradient of `pose_gradient`.

    The gradient is 0 along directions in which the matrix would no longer be rigid.
    """
    rotation, translation = camera.world_to_camera[:3, :3], camera.world_to_camera[:3, 3]
    shift = pose[:3]
    x, y, z = pose[3:] - np.cross(translation, shift)
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.concatenate([0.5 * skew @ rotation, shift[:, None]], axis=1)
