"""Gradients from the image back to the Gaussians, through the sort permutation: ∇θ[π(i)] += g_i."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pocketgs.splat.cpu.lanes import LANES, broadcast, load, store
from pocketgs.splat.cpu.layout import (
    EXPONENT_XX,
    EXPONENT_XY,
    EXPONENT_YY,
    GRADIENT_LOG_SCALE,
    GRADIENT_MEAN,
    GRADIENT_OPACITY,
    GRADIENT_ROTATION,
    GRADIENT_SH,
    LOG2_OPACITY,
    View,
)
from pocketgs.splat.cpu.project import (
    Jacobian,
    clamped_slopes,
    direction_to,
    footprint,
    jacobian_at,
    to_camera,
    unclipped_colour,
)
from pocketgs.splat.cpu.rasterize_backward import (
    SUM_BLUE,
    SUM_EXPONENT,
    SUM_GREEN,
    SUM_RED,
    SUM_X,
    SUM_XX,
    SUM_XY,
    SUM_Y,
    SUM_YY,
)
from pocketgs.splat.cpu.spherical_harmonics import sh_basis, sh_basis_gradient
from pocketgs.splat.cpu.statistics import collect
from pocketgs.splat.cpu.vectors import Vector, axes_of, dot, scaled, transposed_times
from pocketgs.system.compile import inlined, parallel_kernel, part
from pocketgs.system.dealing import PIECE, first_piece, take

LN2 = math.log(2.0)

CovarianceGradient = tuple[float, float, float]
"""Gradient with respect to Σ': xx, xy, yy of a symmetric matrix."""


@inlined
def _add_up(entry_sums: np.ndarray, first_slot: int, end_slot: int, total: np.ndarray) -> None:
    """Sum a splat's rows, one per tile that it entered."""
    row = broadcast(np.float32(0.0))
    for slot in range(first_slot, end_slot):
        row = row + load(entry_sums, slot * LANES)
    store(total, 0, row)


@inlined
def _covariance_gradient(splat: np.ndarray, total: np.ndarray) -> tuple[tuple[float, float], CovarianceGradient]:
    """Gradient with respect to the projected centre, and to Σ'.

    With Q = Σ'⁻¹ and v the gradient of each pixel's exponent, ∂L/∂μ = Q Σ v d and ∂L/∂Q = -½ Σ v d dᵀ, and
    ∂L/∂Σ' = -Q ∂L/∂Q Q.
    """
    xx, xy, yy = -2.0 * LN2 * splat[EXPONENT_XX], -LN2 * splat[EXPONENT_XY], -2.0 * LN2 * splat[EXPONENT_YY]
    d_mean = (xx * total[SUM_X] + xy * total[SUM_Y], xy * total[SUM_X] + yy * total[SUM_Y])
    # Q M for M = Σ v d dᵀ, then ½ Q M Q.
    a, b = xx * total[SUM_XX] + xy * total[SUM_XY], xx * total[SUM_XY] + xy * total[SUM_YY]
    c, d = xy * total[SUM_XX] + yy * total[SUM_XY], xy * total[SUM_XY] + yy * total[SUM_YY]
    return d_mean, (0.5 * (a * xx + b * xy), 0.5 * (a * xy + b * yy), 0.5 * (c * xy + d * yy))


@inlined
def _shape_backward(
    view: View,
    jacobian: Jacobian,
    log_scale: np.ndarray,
    quaternion: np.ndarray,
    d_covariance: CovarianceGradient,
    gradient: np.ndarray,
) -> Jacobian:
    """Write the gradients of scales and rotation; return that of the Jacobian's four entries."""
    axes = axes_of(quaternion)
    d_xx, d_xy, d_yy = d_covariance
    d_jacobian = (0.0, 0.0, 0.0, 0.0)
    skew = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    for k in range(3):
        axis = axes[k]
        scale = math.exp(float(log_scale[k]))
        a, u = footprint(view, jacobian, axis, scale)
        du = (2.0 * (d_xx * u[0] + d_xy * u[1]), 2.0 * (d_xy * u[0] + d_yy * u[1]))
        d_jacobian = (
            d_jacobian[0] + du[0] * a[0],
            d_jacobian[1] + du[0] * a[2],
            d_jacobian[2] + du[1] * a[1],
            d_jacobian[3] + du[1] * a[2],
        )
        d_a = (jacobian[0] * du[0], jacobian[2] * du[1], jacobian[1] * du[0] + jacobian[3] * du[1])
        d_axis = scaled(transposed_times(view.rotation, d_a), scale)
        gradient[GRADIENT_LOG_SCALE + k] = dot(axis, d_axis)
        row = (dot(axes[0], d_axis), dot(axes[1], d_axis), dot(axes[2], d_axis))
        skew = (skew[1], skew[2], row)
    # skew[k][j] is (Rᵀ ∂L/∂R)[j, k]; q ← q ⊗ exp(½δ) turns R into R exp([δ]×).
    gradient[GRADIENT_ROTATION] = skew[1][2] - skew[2][1]
    gradient[GRADIENT_ROTATION + 1] = skew[2][0] - skew[0][2]
    gradient[GRADIENT_ROTATION + 2] = skew[0][1] - skew[1][0]
    return d_jacobian


@inlined
def _position_backward(
    view: View, local: Vector, jacobian: Jacobian, d_mean: tuple[float, float], d_jacobian: Jacobian
) -> Vector:
    """Gradient with respect to the camera-space position, from the projected centre and from the Jacobian."""
    x, y, z = local
    slope_x, slope_y = clamped_slopes(view, local)
    d_x = d_mean[0] * view.fx / z
    d_y = d_mean[1] * view.fy / z
    d_z = -(d_x * x + d_y * y) / z
    xx, xz, yy, yz = jacobian
    # xx = fx/z and xz = -fx x/z², or -fx · limit/z where clamped.
    d_z -= (xx * d_jacobian[0] + yy * d_jacobian[2]) / z
    if slope_x == x / z:
        d_x -= xx / z * d_jacobian[1]
        d_z -= 2.0 * xz / z * d_jacobian[1]
    else:
        d_z -= xz / z * d_jacobian[1]
    if slope_y == y / z:
        d_y -= yy / z * d_jacobian[3]
        d_z -= 2.0 * yz / z * d_jacobian[3]
    else:
        d_z -= yz / z * d_jacobian[3]
    return (d_x, d_y, d_z)


@inlined
def _colour_backward(
    view: View,
    mean: np.ndarray,
    sh: np.ndarray,
    total: np.ndarray,
    basis: np.ndarray,
    basis_gradient: np.ndarray,
    gradient: np.ndarray,
) -> Vector:
    """Write the gradient of the SH coefficients; return that of the world position through the viewing direction."""
    count = sh.shape[0]
    direction, distance = direction_to(view, mean)
    sh_basis(direction[0], direction[1], direction[2], count, basis)
    sh_basis_gradient(direction[0], direction[1], direction[2], count, basis_gradient)
    d_x, d_y, d_z = 0.0, 0.0, 0.0
    d_colours = (total[SUM_RED], total[SUM_GREEN], total[SUM_BLUE])
    for channel in range(3):
        d_colour = d_colours[channel]
        if unclipped_colour(sh, basis, channel) <= 0.0:
            d_colour = 0.0
        for k in range(count):
            gradient[GRADIENT_SH + 3 * k + channel] = basis[k] * d_colour
            weight = sh[k, channel] * d_colour
            d_x += basis_gradient[k, 0] * weight
            d_y += basis_gradient[k, 1] * weight
            d_z += basis_gradient[k, 2] * weight
    # A unit vector's derivative keeps only what is across it.
    along = dot(direction, (d_x, d_y, d_z))
    return (
        (d_x - along * direction[0]) / distance,
        (d_y - along * direction[1]) / distance,
        (d_z - along * direction[2]) / distance,
    )


@part
def _project_range_backward(
    means: np.ndarray,
    log_scales: np.ndarray,
    quaternions: np.ndarray,
    sh: np.ndarray,
    view: View,
    first: int,
    end: int,
    splats: np.ndarray,
    order: np.ndarray,
    first_slots: np.ndarray,
    entry_sums: np.ndarray,
    statistics: np.ndarray,
    gradients: np.ndarray,
) -> None:
    """`project_backward` for the visible Gaussians from rank `first` up to `end`."""
    total, basis, basis_gradient = np.empty(LANES, np.float32), np.empty(16), np.empty((16, 3))
    for rank in range(first, end):
        i = order[rank]
        gradient, splat = gradients[i], splats[i]
        _add_up(entry_sums, first_slots[rank], first_slots[rank + 1], total)
        d_mean, d_covariance = _covariance_gradient(splat, total)
        if len(statistics) > 0:
            collect(view, splat, d_mean, statistics[i])
        gradient[GRADIENT_OPACITY] = total[SUM_EXPONENT] * (1.0 - math.exp(LN2 * splat[LOG2_OPACITY]))
        local = to_camera(view, means[i])
        jacobian = jacobian_at(view, local)
        d_jacobian = _shape_backward(view, jacobian, log_scales[i], quaternions[i], d_covariance, gradient)
        d_local = _position_backward(view, local, jacobian, d_mean, d_jacobian)
        d_world = transposed_times(view.rotation, d_local)
        d_direction = _colour_backward(view, means[i], sh[i], total, basis, basis_gradient, gradient)
        for k in range(3):
            gradient[GRADIENT_MEAN + k] = d_world[k] + d_direction[k]


@parallel_kernel
def project_backward(
    means: np.ndarray,
    log_scales: np.ndarray,
    quaternions: np.ndarray,
    sh: np.ndarray,
    view: View,
    threads: int,
    splats: np.ndarray,
    order: np.ndarray,
    first_slots: np.ndarray,
    entry_sums: np.ndarray,
    statistics: np.ndarray,
    gradients: np.ndarray,
) -> None:
    """Gradient of the loss with respect to every Gaussian, in canonical order.

    Args:
        means: (N, 3) float32.
        log_scales: (N, 3) float32.
        quaternions: (N, 4) float32 of unit length.
        sh: (N, K, 3) float32.
        view: the camera.
        threads: number of threads that share the work.
        splats: what `project` wrote.
        order: (V,) the visible Gaussians by depth: π.
        first_slots: (V + 1,) where each one's rows of `entry_sums` begin.
        entry_sums: what `rasterize_backward` wrote.
        statistics: (N, STATISTICS) float32 sums, added to where visible, or (0, STATISTICS) for none.
        gradients: (N, GRADIENT_SH + 3 K) float32, all 0; written where visible.
    """
    counter = first_piece()
    for _ in prange(threads):
        first = PIECE * take(counter)
        while first < len(order):
            end = min(first + PIECE, len(order))
            _project_range_backward(
                means,
                log_scales,
                quaternions,
                sh,
                view,
                first,
                end,
                splats,
                order,
                first_slots,
                entry_sums,
                statistics,
                gradients,
            )
            first = PIECE * take(counter)
