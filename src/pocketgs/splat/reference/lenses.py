"""Linearised projection through lenses: the derivative J, and gradients through it.

Every lens maps a point (x, y, z) in the camera's axes to the image. EWA splatting linearises it around a Gaussian's
centre (Zwicker et al. 2002, section 6), so Σ' = J W Σ Wᵀ Jᵀ, and gradients through J need second derivatives.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.geometry.lens import Lens
from pocketgs.splat.slope_limits import slope_limits

NEAR_AXIS = 0.01
"""A fisheye's quotients by r use a power series if (r/z)² is less than this."""


@dataclass(frozen=True)
class Linearised:
    """The projection, linearised around (N, 3) points in the camera's axes.

    Attributes:
        jacobian: (N, 2, 3) for projecting covariances; clamped to the image's margin, beyond which it would explode.
        exact: (N, 2, 3) derivative of the projected centres themselves.
        backward: maps the (N, 2, 3) gradient with respect to `jacobian` to the (N, 3) one with respect to the points.
    """

    jacobian: np.ndarray
    exact: np.ndarray
    backward: Callable[[np.ndarray], np.ndarray]


def linearised(local: np.ndarray, camera: Camera) -> Linearised:
    """Linearise the projection of a camera around (N, 3) points in its axes."""
    focal = np.array([camera.fx, camera.fy])
    if camera.lens.model == "orthographic":
        jacobian = np.tile(np.diag(focal) @ np.eye(2, 3), (len(local), 1, 1))
        return Linearised(jacobian, jacobian, lambda d_jacobian: np.zeros_like(local))
    if camera.lens.model == "fisheye":
        return _fisheye(local, camera.lens, focal)
    return _perspective(local, camera, focal)


def is_beside(local: np.ndarray, camera: Camera) -> np.ndarray:
    """(N,) bool: whether points are so far beside the image that `linearised` clamps their slopes."""
    if camera.lens.model in ("orthographic", "fisheye"):
        return np.zeros(len(local), np.bool_)
    slopes, (low, high) = local[:, :2] / local[:, 2:], slope_limits(camera)
    return np.asarray(((slopes < low) | (slopes > high)).any(axis=1))


def _perspective(local: np.ndarray, camera: Camera, focal: np.ndarray) -> Linearised:
    """(x, y, z) ↦ f d(x/z, y/z) + c, with d of `_Distortion`."""
    depth = local[:, 2]
    slopes = local[:, :2] / local[:, 2:]
    low, high = slope_limits(camera)
    held = np.clip(slopes, low, high)
    free = held == slopes
    at_centre, around = _Distortion.at(camera.lens, slopes), _Distortion.at(camera.lens, held)
    jacobian = _through_slopes(around.first, held, depth, focal)

    def backward(d_jacobian: np.ndarray) -> np.ndarray:
        # Columns 0 and 1 are f D/z, and column 2 is -(column 0 · x/z + column 1 · y/z), with D = ∂d/∂(x/z, y/z).
        d_columns = d_jacobian[:, :, :2] - d_jacobian[:, :, 2:] * held[:, None, :]
        d_held = -np.einsum("nij,ni->nj", jacobian[:, :, :2], d_jacobian[:, :, 2])
        d_first = d_columns * focal[:, None] / depth[:, None, None]
        d_held += np.einsum("nij,nijk->nk", d_first, around.second)
        d_slopes = np.where(free, d_held, 0.0)
        d_depth = -np.einsum("nij,nij->n", d_columns, jacobian[:, :, :2]) - np.sum(d_slopes * slopes, axis=1)
        return np.column_stack([d_slopes, d_depth]) / depth[:, None]

    return Linearised(jacobian, _through_slopes(at_centre.first, slopes, depth, focal), backward)


def _through_slopes(first: np.ndarray, slopes: np.ndarray, depth: np.ndarray, focal: np.ndarray) -> np.ndarray:
    """(N, 2, 3) derivative of f d(x/z, y/z), from the derivative of d."""
    columns = focal[:, None] * first / depth[:, None, None]
    return np.concatenate([columns, -np.einsum("nij,nj->ni", columns, slopes)[:, :, None]], axis=2)


@dataclass(frozen=True)
class _Distortion:
    """Derivatives of OpenCV's distortion at (N, 2) normalised coordinates; `geometry.lens.distort` is its value.

    Attributes:
        first: (N, 2, 2), [n, i, j] = ∂d_i/∂x_j.
        second: (N, 2, 2, 2), [n, i, j, k] = ∂²d_i/∂x_j∂x_k.
    """

    first: np.ndarray
    second: np.ndarray

    @staticmethod
    def at(lens: Lens, points: np.ndarray) -> _Distortion:
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = lens.padded
        q = np.sum(points * points, axis=1)
        # The radial factor R = N/M as a function of q = x² + y².
        n, n1, n2 = 1 + q * (k1 + q * (k2 + q * k3)), k1 + q * (2 * k2 + q * 3 * k3), 2 * k2 + 6 * k3 * q
        m, m1, m2 = 1 + q * (k4 + q * (k5 + q * k6)), k4 + q * (2 * k5 + q * 3 * k6), 2 * k5 + 6 * k6 * q
        radial = n / m
        radial1 = (n1 - radial * m1) / m
        radial2 = (n2 - 2 * radial1 * m1 - radial * m2) / m
        prism1 = [s1 + 2 * s2 * q, s3 + 2 * s4 * q]
        prism2 = [2 * s2, 2 * s4]
        tangential = [np.array([[6 * p2, 2 * p1], [2 * p1, 2 * p2]]), np.array([[2 * p1, 2 * p2], [2 * p2, 6 * p1]])]
        same = np.eye(2)
        first, second = np.zeros((len(points), 2, 2)), np.zeros((len(points), 2, 2, 2))
        for i in (0, 1):
            across = points[:, i]
            for j in (0, 1):
                first[:, i, j] = radial * same[i, j] + 2 * points[:, j] * (across * radial1 + prism1[i])
                first[:, i, j] += points @ tangential[i][j]
                for k in (0, 1):
                    pair = points[:, j] * points[:, k]
                    second[:, i, j, k] = 2 * radial1 * (same[i, j] * points[:, k] + same[i, k] * points[:, j])
                    second[:, i, j, k] += 2 * same[j, k] * (across * radial1 + prism1[i])
                    second[:, i, j, k] += 4 * pair * (across * radial2 + prism2[i]) + tangential[i][j, k]
        return _Distortion(first, second)


def _fisheye(local: np.ndarray, lens: Lens, focal: np.ndarray) -> Linearised:
    """(x, y, z) ↦ f s (x, y) + c, where s = θ_d / r for r² = x² + y² and θ = atan2(r, z).

    s depends on x and y only through r, so its derivatives are ∂s/∂x_i = A x_i, ∂s/∂z = B, and those of A and B are
    C x_i and E, and E x_i and F.
    """
    across = local[:, :2]
    s, a, b, c, e, f = _fisheye_derivatives(local, lens)
    jacobian = np.zeros((len(local), 2, 3))
    jacobian[:, :, :2] = s[:, None, None] * np.eye(2) + a[:, None, None] * across[:, :, None] * across[:, None, :]
    jacobian[:, :, 2] = b[:, None] * across
    jacobian *= focal[:, None]

    def backward(d_jacobian: np.ndarray) -> np.ndarray:
        d = d_jacobian * focal[:, None]
        d_s, d_a = d[:, 0, 0] + d[:, 1, 1], np.einsum("nij,ni,nj->n", d[:, :, :2], across, across)
        d_b = np.sum(d[:, :, 2] * across, axis=1)
        d_across = (d_s * a + d_a * c + d_b * e)[:, None] * across + b[:, None] * d[:, :, 2]
        d_across += a[:, None] * np.einsum("nij,nj->ni", d[:, :, :2] + np.swapaxes(d[:, :, :2], 1, 2), across)
        return np.column_stack([d_across, d_s * b + d_a * e + d_b * f])

    return Linearised(jacobian, jacobian, backward)


def _fisheye_derivatives(local: np.ndarray, lens: Lens) -> tuple[np.ndarray, ...]:
    """s, A, B, C, E, F of `_fisheye`, each (N,).

    With w = θ² and θ_d = θ P(w), s = s0 P(w) where s0 = θ/r is a lens without coefficients.
    """
    k1, k2, k3, k4 = lens.coefficients
    z, q = local[:, 2], np.sum(local[:, :2] ** 2, axis=1)
    square = q + z * z
    along = z / square
    s0, a0, c0 = _equidistant(z, q)
    w = s0 * s0 * q
    p = 1 + w * (k1 + w * (k2 + w * (k3 + w * k4)))
    p1 = k1 + w * (2 * k2 + w * (3 * k3 + w * 4 * k4))
    p2 = 2 * k2 + w * (6 * k3 + w * 12 * k4)
    slope, bend = p + 2 * w * p1, s0 * (6 * p1 + 4 * w * p2)  # θ_d' and θ_d''/r
    a = a0 * p + 2 * s0 * s0 * along * p1
    c = c0 * p + 6 * s0 * a0 * along * p1 - 4 * s0 * s0 * along / square * p1 + 4 * s0**3 * along**2 * p2
    b = -slope / square
    e = (2 * slope - z * bend) / square**2
    f = (2 * slope * z + bend * q) / square**2
    return s0 * p, a, b, c, e, f


def _equidistant(z: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """s0 = θ/r, A0 = (∂s0/∂r)/r and C0 = (∂A0/∂r)/r, from z and q = r². Power series are used close to the axis."""
    with np.errstate(all="ignore"):
        r, square = np.sqrt(q), q + z * z
        s0 = np.arctan2(r, z) / r
        a0 = (z / square - s0) / q
        c0 = (-2 * z / square**2 - 3 * a0) / q
        n, t = np.arange(12), q / (z * z)
        powers = np.where(t < NEAR_AXIS, t, 0.0)[:, None] ** n
        # s0 z = Σ (-t)ⁿ/(2n + 1); its derivatives with respect to q follow term by term.
        near_s = powers @ ((-1.0) ** n / (2 * n + 1)) / z
        near_a = powers @ (-((-1.0) ** n) * 2 * (n + 1) / (2 * n + 3)) / z**3
        near_c = powers @ ((-1.0) ** n * 4 * (n + 1) * (n + 2) / (2 * n + 5)) / z**5
    near = (z > 0) & (t < NEAR_AXIS)
    return np.where(near, near_s, s0), np.where(near, near_a, a0), np.where(near, near_c, c0)
