"""Gradients from the image back to the Gaussians: ∇θ[π(i)] += g_i.

Gaussians are processed in memory order, sixteen at a time: their rows are transposed to columns of LANES, so that the
formulas of `project` apply to sixteen Gaussians at once, in float32.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pocketgs.splat.constants import LOW_PASS
from pocketgs.splat.cpu.bin import TileLists
from pocketgs.splat.cpu.exp2 import exp
from pocketgs.splat.cpu.lanes import LANES, Floats, broadcast, load, square_root, store
from pocketgs.splat.cpu.layout import (
    COLOURS,
    EXPONENT_XX,
    EXPONENT_XY,
    EXPONENT_YY,
    GRADIENT_LOG_SCALE,
    GRADIENT_MEAN,
    GRADIENT_OPACITY,
    GRADIENT_ROTATION,
    GRADIENT_SH,
    LOG2_OPACITY,
    RED,
    SLOTS_COUNT,
    SLOTS_FIRST,
    SceneArrays,
    View,
)
from pocketgs.splat.cpu.lenses.formulas import jacobian_at, position_backward
from pocketgs.splat.cpu.lenses.jacobians import Jacobian, back_along, no_gradient, with_product
from pocketgs.splat.cpu.lenses.lens import KernelLens
from pocketgs.splat.cpu.project import direction_to, footprint, sharp_covariance, sharp_determinant
from pocketgs.splat.cpu.spherical_harmonics import sh_basis, sh_basis_gradient
from pocketgs.splat.cpu.statistics import collect
from pocketgs.splat.cpu.tile_sums import (
    SUM_ABSOLUTE_X,
    SUM_EXPONENT,
    SUM_RED,
    SUM_X,
    SUM_XX,
    SUM_XY,
    SUM_Y,
    SUM_YY,
)
from pocketgs.splat.cpu.vectors import Vector, axes_of, dot, scaled, times, transposed_times
from pocketgs.system.compile import inlined, parallel_kernel, part
from pocketgs.system.dealing import PIECE, first_piece, take

LN2 = math.log(2.0)

# Columns of a block of LANES Gaussians: inputs, the sums of their intersections, and their gradients except for colour.
_MEAN, _LOG_SCALE, _QUATERNION, _SPLAT = 0, 3, 6, 10
_SUMS = _SPLAT + LOG2_OPACITY + 1
_GRADIENT = _SUMS + LANES
_CENTRE = _GRADIENT + GRADIENT_SH
_COLUMNS = _CENTRE + 2

CovarianceGradient = tuple[Floats, Floats, Floats]
"""Gradient with respect to Σ': xx, xy, yy of a symmetric matrix."""


@inlined
def _column(block: np.ndarray, number: int) -> Floats:
    return load(block, number * LANES)


@inlined
def _columns3(block: np.ndarray, number: int) -> Vector:
    return (_column(block, number), _column(block, number + 1), _column(block, number + 2))


@inlined
def _set_column(block: np.ndarray, number: int, values: Floats) -> None:
    store(block, number * LANES, values)


@part
def _add_up(intersection_sums: np.ndarray, slots: np.ndarray, row: int, total: np.ndarray) -> None:
    """Sum a splat's rows, one per intersected tile."""
    for part_of_row in range(0, row, LANES):
        vector = broadcast(np.float32(0.0))
        for slot in range(slots[SLOTS_FIRST], slots[SLOTS_FIRST] + slots[SLOTS_COUNT]):
            vector = vector + load(intersection_sums, slot * row + part_of_row)
        store(total, part_of_row, vector)


@part
def _read(i: int, lane: int, scene: SceneArrays, splats: np.ndarray, total: np.ndarray, block: np.ndarray) -> None:
    """Copy Gaussian i's rows to one lane of every column."""
    for k in range(3):
        block[(_MEAN + k) * LANES + lane] = scene.means[i, k]
        block[(_LOG_SCALE + k) * LANES + lane] = scene.log_scales[i, k]
    for k in range(4):
        block[(_QUATERNION + k) * LANES + lane] = scene.quaternions[i, k]
    for k in range(LOG2_OPACITY + 1):
        block[(_SPLAT + k) * LANES + lane] = splats[i, k]
    for k in range(SUM_YY + 1):
        block[(_SUMS + k) * LANES + lane] = total[k]


@inlined
def _covariance_gradient(block: np.ndarray) -> tuple[tuple[Floats, Floats], CovarianceGradient]:
    """Gradients with respect to the projected centre and to Σ'.

    With Q = Σ'⁻¹ and v the gradient of each pixel's exponent, ∂L/∂μ = Q Σ v d and ∂L/∂Q = -½ Σ v d dᵀ, and
    ∂L/∂Σ' = -Q ∂L/∂Q Q.
    """
    xx = _column(block, _SPLAT + EXPONENT_XX) * (-2.0 * LN2)
    xy = _column(block, _SPLAT + EXPONENT_XY) * -LN2
    yy = _column(block, _SPLAT + EXPONENT_YY) * (-2.0 * LN2)
    x, y = _column(block, _SUMS + SUM_X), _column(block, _SUMS + SUM_Y)
    # Q M for M = Σ v d dᵀ, then ½ Q M Q.
    m_xx, m_xy = _column(block, _SUMS + SUM_XX), _column(block, _SUMS + SUM_XY)
    m_yy = _column(block, _SUMS + SUM_YY)
    a, b = xx * m_xx + xy * m_xy, xx * m_xy + xy * m_yy
    c, d = xy * m_xx + yy * m_xy, xy * m_xy + yy * m_yy
    d_covariance = ((a * xx + b * xy) * 0.5, (a * xy + b * yy) * 0.5, (c * xy + d * yy) * 0.5)
    return (xx * x + xy * y, xy * x + yy * y), d_covariance


@inlined
def _shape_backward(view: View, jacobian: Jacobian, block: np.ndarray, d_covariance: CovarianceGradient) -> Jacobian:
    """Write the gradients of scales and rotation; return that of the Jacobian."""
    w, (x, y, z) = _column(block, _QUATERNION), _columns3(block, _QUATERNION + 1)
    axes = axes_of((w, x, y, z))
    d_jacobian = no_gradient(jacobian)
    d_jacobian, row_x = _axis_backward(view, jacobian, block, axes, 0, d_covariance, d_jacobian)
    d_jacobian, row_y = _axis_backward(view, jacobian, block, axes, 1, d_covariance, d_jacobian)
    d_jacobian, row_z = _axis_backward(view, jacobian, block, axes, 2, d_covariance, d_jacobian)
    # row_k[j] is (Rᵀ ∂L/∂R)[j, k]; q ← q ⊗ exp(½δ) turns R into R exp([δ]×).
    _set_column(block, _GRADIENT + GRADIENT_ROTATION, row_y[2] - row_z[1])
    _set_column(block, _GRADIENT + GRADIENT_ROTATION + 1, row_z[0] - row_x[2])
    _set_column(block, _GRADIENT + GRADIENT_ROTATION + 2, row_x[1] - row_y[0])
    return d_jacobian


@inlined
def _axis_backward(
    view: View,
    jacobian: Jacobian,
    block: np.ndarray,
    axes: tuple[Vector, Vector, Vector],
    k: int,
    d_covariance: CovarianceGradient,
    d_jacobian: Jacobian,
) -> tuple[Jacobian, Vector]:
    """One axis's part of `_shape_backward`: ∂L/∂J so far, and ∂L/∂axis along the axes."""
    d_xx, d_xy, d_yy = d_covariance
    scale = exp(_column(block, _LOG_SCALE + k))
    a, u = footprint(view, jacobian, axes[k], scale)
    du = ((d_xx * u[0] + d_xy * u[1]) * 2.0, (d_xy * u[0] + d_yy * u[1]) * 2.0)
    d_jacobian = with_product(d_jacobian, du, a)
    d_axis = scaled(transposed_times(view.rotation, back_along(jacobian, du)), scale)
    _set_column(block, _GRADIENT + GRADIENT_LOG_SCALE + k, dot(axes[k], d_axis))
    return d_jacobian, (dot(axes[0], d_axis), dot(axes[1], d_axis), dot(axes[2], d_axis))


@inlined
def _compensation_backward(
    view: View, jacobian: Jacobian, block: np.ndarray, d_covariance: CovarianceGradient
) -> tuple[CovarianceGradient, Floats]:
    """∂L/∂Σ' including that through the factor √(det S / det Σ') for S = Σ' - 0.3 I, and the factor itself.

    The gradient of its logarithm is ½ (S⁻¹ - Σ'⁻¹); the logarithm of an opacity has the gradient of the pixels'
    exponents.
    """
    w, (x, y, z) = _column(block, _QUATERNION), _columns3(block, _QUATERNION + 1)
    axes = axes_of((w, x, y, z))
    _, p = footprint(view, jacobian, axes[0], exp(_column(block, _LOG_SCALE)))
    _, q = footprint(view, jacobian, axes[1], exp(_column(block, _LOG_SCALE + 1)))
    _, r = footprint(view, jacobian, axes[2], exp(_column(block, _LOG_SCALE + 2)))
    sharp = sharp_determinant(p, q, r)
    xx, xy, yy = sharp_covariance(p, q, r)
    # det Σ' = det S + 0.3 trace S + 0.3².
    blurred = sharp + (xx + yy) * LOW_PASS + LOW_PASS * LOW_PASS
    half = _column(block, _SUMS + SUM_EXPONENT) * 0.5
    d_xx, d_xy, d_yy = d_covariance
    d_xx = d_xx + half * (yy / sharp - (yy + LOW_PASS) / blurred)
    d_xy = d_xy - half * (xy / sharp - xy / blurred)
    d_yy = d_yy + half * (xx / sharp - (xx + LOW_PASS) / blurred)
    return (d_xx, d_xy, d_yy), square_root(sharp / blurred)


@part
def _block_backward(view: View, lens: KernelLens, block: np.ndarray) -> None:
    """Compute the columns of the gradients from those of the inputs."""
    offset_x, offset_y, offset_z = _columns3(block, _MEAN)
    offset = (offset_x - view.centre[0], offset_y - view.centre[1], offset_z - view.centre[2])
    local = times(view.rotation, offset)
    jacobian = jacobian_at(view, lens, local)
    d_mean, d_covariance = _covariance_gradient(block)
    opacity = exp(_column(block, _SPLAT + LOG2_OPACITY) * LN2)
    if view.antialiased:
        d_covariance, compensation = _compensation_backward(view, jacobian, block, d_covariance)
        opacity = opacity / compensation
    d_jacobian = _shape_backward(view, jacobian, block, d_covariance)
    d_local = position_backward(view, lens, local, jacobian, d_mean, d_jacobian)
    d_x, d_y, d_z = transposed_times(view.rotation, d_local)
    _set_column(block, _GRADIENT + GRADIENT_MEAN, d_x)
    _set_column(block, _GRADIENT + GRADIENT_MEAN + 1, d_y)
    _set_column(block, _GRADIENT + GRADIENT_MEAN + 2, d_z)
    _set_column(block, _GRADIENT + GRADIENT_OPACITY, _column(block, _SUMS + SUM_EXPONENT) * (1.0 - opacity))
    _set_column(block, _CENTRE, d_mean[0])
    _set_column(block, _CENTRE + 1, d_mean[1])


@part
def _colour_backward(
    view: View,
    mean: np.ndarray,
    sh: np.ndarray,
    splat: np.ndarray,
    total: np.ndarray,
    basis: np.ndarray,
    basis_gradient: np.ndarray,
    gradient: np.ndarray,
) -> None:
    """Write the gradient of the SH coefficients; add that of the mean through the viewing direction."""
    count = sh.shape[0]
    direction, distance = direction_to(view, mean)
    sh_basis(direction[0], direction[1], direction[2], count, basis)
    red, green, blue = 0.0, 0.0, 0.0
    # A colour clamped to 0 has no gradient.
    if splat[RED] > 0.0:
        red = float(total[SUM_RED])
    if splat[RED + 1] > 0.0:
        green = float(total[SUM_RED + 1])
    if splat[RED + 2] > 0.0:
        blue = float(total[SUM_RED + 2])
    for k in range(count):
        row = GRADIENT_SH + 3 * k
        gradient[row], gradient[row + 1], gradient[row + 2] = basis[k] * red, basis[k] * green, basis[k] * blue
    if count > 1:
        sh_basis_gradient(direction[0], direction[1], direction[2], count, basis_gradient)
        d_x, d_y, d_z = 0.0, 0.0, 0.0
        for k in range(1, count):
            weight = sh[k, 0] * red + sh[k, 1] * green + sh[k, 2] * blue
            d_x += basis_gradient[k, 0] * weight
            d_y += basis_gradient[k, 1] * weight
            d_z += basis_gradient[k, 2] * weight
        # Normalisation removes the component along the direction.
        along = dot(direction, (d_x, d_y, d_z))
        gradient[GRADIENT_MEAN] += (d_x - along * direction[0]) / distance
        gradient[GRADIENT_MEAN + 1] += (d_y - along * direction[1]) / distance
        gradient[GRADIENT_MEAN + 2] += (d_z - along * direction[2]) / distance


@part
def _project_range_backward(
    scene: SceneArrays,
    view: View,
    lens: KernelLens,
    visible: np.ndarray,
    splats: np.ndarray,
    lists: TileLists,
    row: int,
    intersection_sums: np.ndarray,
    statistics: np.ndarray,
    gradients: np.ndarray,
    d_centres: np.ndarray,
    d_channels: np.ndarray,
) -> None:
    """`project_backward` for a range of the visible Gaussians."""
    basis, basis_gradient = np.empty(16), np.empty((16, 3))
    block, totals = np.zeros(_COLUMNS * LANES, np.float32), np.zeros((LANES, row), np.float32)
    for first in range(0, len(visible), LANES):
        count = min(LANES, len(visible) - first)
        for lane in range(count):
            i = visible[first + lane]
            _add_up(intersection_sums, lists.slots[i], row, totals[lane])
            _read(i, lane, scene, splats, totals[lane], block)
        _block_backward(view, lens, block)
        for lane in range(count):
            i, total = visible[first + lane], totals[lane]
            gradient = gradients[i]
            for column in range(GRADIENT_SH):
                gradient[column] = block[(_GRADIENT + column) * LANES + lane]
            if scene.sh.shape[1] > 0:
                _colour_backward(view, scene.means[i], scene.sh[i], splats[i], total, basis, basis_gradient, gradient)
            x, y = block[_CENTRE * LANES + lane], block[(_CENTRE + 1) * LANES + lane]
            if len(statistics):
                collect(view, splats[i], (x, y), statistics[i])
            if len(d_centres):
                d_centres[i, 0], d_centres[i, 1] = x, y
                d_centres[i, 2], d_centres[i, 3] = total[SUM_ABSOLUTE_X], total[SUM_ABSOLUTE_X + 1]
            if len(d_channels):
                for channel in range(d_channels.shape[1]):
                    place = SUM_RED + channel if channel < COLOURS else LANES + channel - COLOURS
                    d_channels[i, channel] = total[place]


@parallel_kernel
def project_backward(
    scene: SceneArrays,
    view: View,
    lens: KernelLens,
    threads: int,
    splats: np.ndarray,
    visible: np.ndarray,
    lists: TileLists,
    row: int,
    intersection_sums: np.ndarray,
    statistics: np.ndarray,
    gradients: np.ndarray,
    d_centres: np.ndarray,
    d_channels: np.ndarray,
) -> None:
    """Gradient of the loss with respect to every Gaussian.

    Args:
        scene: the Gaussians.
        view: the camera.
        lens: of the camera.
        threads: number of threads.
        splats: from `project`.
        visible: (V,) the visible Gaussians, in memory order.
        lists: of the image.
        row: length of a row of `intersection_sums`.
        intersection_sums: from `rasterize_backward`.
        statistics: (N, STATISTICS) float32 sums, updated where visible, or (0, STATISTICS) for none.
        gradients: (N, GRADIENT_SH + 3 K) float32, all 0; written where visible.
        d_centres: (N, 4) float32, written where visible: the gradient of the projected centre, and its magnitudes
            summed over pixels, which `rasterize_backward` must have computed. Or (0, 4).
        d_channels: (N, C) float32, written where visible: the gradient of the channels. Or (0, C).
    """
    counter = first_piece()
    for _ in prange(threads):
        first = PIECE * take(counter)
        while first < len(visible):
            _project_range_backward(
                scene,
                view,
                lens,
                visible[first : first + PIECE],
                splats,
                lists,
                row,
                intersection_sums,
                statistics,
                gradients,
                d_centres,
                d_channels,
            )
            first = PIECE * take(counter)
