"""Projection as an operator: from Gaussians with activated parameters to arrays of splats, and all gradients.

`project` and `project_backward` do the same within a training step, where only the sums of tiles have gradients. Here
each output of the projection may have a gradient, and the camera's matrix gets one too.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pocketgs.splat.constants import ALPHA_MIN, MAX_VARIANCE, MIN_DETERMINANT
from pocketgs.splat.cpu.layout import View
from pocketgs.splat.cpu.lenses.formulas import centre_of, jacobian_at, position_backward
from pocketgs.splat.cpu.lenses.jacobians import Jacobian, back_along, no_gradient, with_product
from pocketgs.splat.cpu.lenses.lens import KernelLens
from pocketgs.splat.cpu.project import footprint, sharp_covariance, to_camera
from pocketgs.splat.cpu.vectors import Vector, axes_of, dot, scaled, transposed_times
from pocketgs.system.compile import inlined, parallel_kernel, part
from pocketgs.system.dealing import PIECE, first_piece, take

MATRIX = 12
"""Number of stored entries of world_to_camera: its upper three rows."""

REACH = 3.33
"""Maximum extent of a splat in standard deviations: that of an opaque one, as rounded by gsplat."""

UNBOUNDED = 1e30
"""Replaces missing opacities, so that all splats extend to REACH."""

_MIN_COMPENSATION = 1e-6


@inlined
def _unit(quaternion: np.ndarray) -> tuple[tuple[float, float, float, float], float]:
    """The normalised quaternion, and its original length."""
    w, x, y, z = float(quaternion[0]), float(quaternion[1]), float(quaternion[2]), float(quaternion[3])
    length = max(math.sqrt(w * w + x * x + y * y + z * z), 1e-12)
    return (w / length, x / length, y / length, z / length), length


@inlined
def _covariance(
    view: View, lens: KernelLens, local: Vector, scale: np.ndarray, quaternion: np.ndarray
) -> tuple[float, float, float]:
    """Σ' before the blur: xx, xy, yy."""
    jacobian = jacobian_at(view, lens, local)
    unit, _ = _unit(quaternion)
    axes = axes_of(unit)
    _, p = footprint(view, jacobian, axes[0], float(scale[0]))
    _, q = footprint(view, jacobian, axes[1], float(scale[1]))
    _, r = footprint(view, jacobian, axes[2], float(scale[2]))
    return sharp_covariance(p, q, r)


@part
def _project_one(
    view: View,
    lens: KernelLens,
    local: Vector,
    scale: np.ndarray,
    quaternion: np.ndarray,
    opacity: float,
    low_pass: float,
    compensated: bool,
    least_radius: float,
    centre: np.ndarray,
    conic: np.ndarray,
    radius: np.ndarray,
) -> float:
    """Write one Gaussian's splat; return its compensation, or -1 if it is not visible."""
    xx, xy, yy = _covariance(view, lens, local, scale, quaternion)
    before = max(xx * yy - xy * xy, 0.0)
    xx, yy = xx + low_pass, yy + low_pass
    determinant = xx * yy - xy * xy
    mean_x, mean_y = centre_of(view, lens, local)
    sound = math.isfinite(mean_x + mean_y) and xx < MAX_VARIANCE and yy < MAX_VARIANCE
    if not (sound and determinant > MIN_DETERMINANT * xx * yy):
        return -1.0
    compensation = math.sqrt(before / determinant)
    if compensated:
        opacity *= compensation
    if not opacity >= ALPHA_MIN:
        return -1.0
    # At most the radius at which the most opaque splat's α is 1/255.
    reach = math.sqrt(2.0 * math.log(opacity / ALPHA_MIN))
    radius_x, radius_y = math.ceil(min(reach, REACH) * math.sqrt(xx)), math.ceil(min(reach, REACH) * math.sqrt(yy))
    if radius_x <= least_radius and radius_y <= least_radius:
        return -1.0
    if not (mean_x + radius_x > 0.0 and mean_x - radius_x < view.width):
        return -1.0
    if not (mean_y + radius_y > 0.0 and mean_y - radius_y < view.height):
        return -1.0
    centre[0], centre[1] = mean_x, mean_y
    conic[0], conic[1], conic[2] = yy / determinant, -xy / determinant, xx / determinant
    radius[0], radius[1] = radius_x, radius_y
    return compensation


@parallel_kernel
def project_ewa(
    means: np.ndarray,
    quaternions: np.ndarray,
    scales: np.ndarray,
    opacities: np.ndarray,
    view: View,
    lens: KernelLens,
    low_pass: float,
    near: float,
    far: float,
    least_radius: float,
    compensated: bool,
    threads: int,
    centres: np.ndarray,
    depths: np.ndarray,
    conics: np.ndarray,
    compensations: np.ndarray,
    radii: np.ndarray,
) -> None:
    """Project Gaussians into one view. Rows of invisible Gaussians are zeros.

    Args:
        means: (N, 3) float32.
        quaternions: (N, 4) float32 of any length.
        scales: (N, 3) float32 standard deviations.
        opacities: (N,) float32, or (0,) to give all Gaussians the maximum extent.
        view: the camera; its matrix need not be a rotation.
        lens: of the camera.
        low_pass: added to both variances on the image, in pixels².
        near: minimum depth.
        far: maximum depth.
        least_radius: Gaussians with radii up to this in both directions, in pixels, are not visible.
        compensated: whether opacities will be multiplied by `compensations`, so that the extents must be too.
        threads: number of threads.
        centres: (N, 2) float32, written, in pixels.
        depths: (N,) float32, written.
        conics: (N, 3) float32, written: xx, xy, yy of the inverse covariance.
        compensations: (N,) float32, written: √(|Σ'| / |Σ' + low pass|).
        radii: (N, 2) int32, written: half the width and height of the region with α of at least 1/255, rounded up.
    """
    counter = first_piece()
    for _ in prange(threads):
        first = PIECE * take(counter)
        while first < len(means):
            for i in range(first, min(first + PIECE, len(means))):
                local = to_camera(view, means[i])
                opacity = float(opacities[i]) if len(opacities) else UNBOUNDED
                compensation = -1.0
                if near <= local[2] <= far:
                    compensation = _project_one(
                        view, lens, local, scales[i], quaternions[i], opacity, low_pass, compensated, least_radius,
                        centres[i], conics[i], radii[i],
                    )  # fmt: skip
                if compensation >= 0.0:
                    depths[i], compensations[i] = local[2], compensation
                else:
                    centres[i, 0], centres[i, 1], depths[i], compensations[i] = 0.0, 0.0, 0.0, 0.0
                    conics[i, 0], conics[i, 1], conics[i, 2] = 0.0, 0.0, 0.0
                    radii[i, 0], radii[i, 1] = 0, 0
            first = PIECE * take(counter)


@inlined
def _covariance_gradient(
    conic: tuple[float, float, float], d_conic: np.ndarray, low_pass: float, compensation: float, d_compensation: float
) -> tuple[float, float, float]:
    """Gradient with respect to Σ', as the xx, xy, yy of a symmetric matrix.

    With Q the inverse, ∂L/∂Σ' = -Q ∂L/∂Q Q; the gradient of ρ² = |Σ| / |Σ + εI| is (1 - ρ²) Q - ε |Q| I.
    """
    xx, xy, yy = conic
    g_xx, g_xy, g_yy = float(d_conic[0]), 0.5 * float(d_conic[1]), float(d_conic[2])
    a, b = xx * g_xx + xy * g_xy, xx * g_xy + xy * g_yy
    c, d = xy * g_xx + yy * g_xy, xy * g_xy + yy * g_yy
    d_xx, d_xy, d_yy = -(a * xx + b * xy), -(a * xy + b * yy), -(c * xy + d * yy)
    d_square = d_compensation * 0.5 / (compensation + _MIN_COMPENSATION)
    rest, blurred = 1.0 - compensation * compensation, low_pass * (xx * yy - xy * xy)
    return d_xx + d_square * (rest * xx - blurred), d_xy + d_square * rest * xy, d_yy + d_square * (rest * yy - blurred)


@part
def _add_outer(column: Vector, row: Vector, matrix: np.ndarray) -> None:
    """Add column · rowᵀ to the left 3 x 3 of a (MATRIX,) matrix."""
    for i in range(3):
        for j in range(3):
            matrix[4 * i + j] += column[i] * row[j]


@inlined
def _axis_backward(
    view: View,
    jacobian: Jacobian,
    axes: tuple[Vector, Vector, Vector],
    k: int,
    scale: np.ndarray,
    d_covariance: tuple[float, float, float],
    d_jacobian: Jacobian,
    d_matrix: np.ndarray,
) -> tuple[Jacobian, Vector, float]:
    """One axis's part of the gradient: ∂L/∂J so far, ∂L/∂axis along the axes, and ∂L/∂scale."""
    d_xx, d_xy, d_yy = d_covariance
    size = float(scale[k])
    a, u = footprint(view, jacobian, axes[k], size)
    du = (2.0 * (d_xx * u[0] + d_xy * u[1]), 2.0 * (d_xy * u[0] + d_yy * u[1]))
    d_jacobian = with_product(d_jacobian, du, a)
    d_a = back_along(jacobian, du)
    if len(d_matrix):
        _add_outer(d_a, scaled(axes[k], size), d_matrix)
    d_axis = transposed_times(view.rotation, d_a)
    row = (size * dot(axes[0], d_axis), size * dot(axes[1], d_axis), size * dot(axes[2], d_axis))
    return d_jacobian, row, dot(axes[k], d_axis)


@part
def _back_one(
    view: View,
    lens: KernelLens,
    mean: np.ndarray,
    quaternion: np.ndarray,
    scale: np.ndarray,
    d_centre: np.ndarray,
    d_depth: float,
    d_covariance: tuple[float, float, float],
    d_mean: np.ndarray,
    d_quaternion: np.ndarray,
    d_scale: np.ndarray,
    d_matrix: np.ndarray,
) -> None:
    """Add one Gaussian's gradients to its rows, and to the camera's matrix if it needs one."""
    local = to_camera(view, mean)
    jacobian = jacobian_at(view, lens, local)
    unit, length = _unit(quaternion)
    axes = axes_of(unit)
    d_jacobian = no_gradient(jacobian)
    d_jacobian, row_x, d_scale_x = _axis_backward(view, jacobian, axes, 0, scale, d_covariance, d_jacobian, d_matrix)
    d_jacobian, row_y, d_scale_y = _axis_backward(view, jacobian, axes, 1, scale, d_covariance, d_jacobian, d_matrix)
    d_jacobian, row_z, d_scale_z = _axis_backward(view, jacobian, axes, 2, scale, d_covariance, d_jacobian, d_matrix)
    d_scale[0] += d_scale_x
    d_scale[1] += d_scale_y
    d_scale[2] += d_scale_z
    # q ← q ⊗ exp(½δ) turns R into R exp([δ]×); a step of q itself is 2 q ⊗ (0, δ) over its length.
    x, y, z = row_y[2] - row_z[1], row_z[0] - row_x[2], row_x[1] - row_y[0]
    q_w, q_x, q_y, q_z = unit
    factor = 2.0 / length
    d_quaternion[0] -= factor * (q_x * x + q_y * y + q_z * z)
    d_quaternion[1] += factor * (q_w * x + q_y * z - q_z * y)
    d_quaternion[2] += factor * (q_w * y + q_z * x - q_x * z)
    d_quaternion[3] += factor * (q_w * z + q_x * y - q_y * x)
    d_place = (float(d_centre[0]), float(d_centre[1]))
    d_x, d_y, d_z = position_backward(view, lens, local, jacobian, d_place, d_jacobian)
    d_local = (d_x, d_y, d_z + d_depth)
    d_world = transposed_times(view.rotation, d_local)
    for c in range(3):
        d_mean[c] += d_world[c]
    if len(d_matrix):
        _add_outer(d_local, (float(mean[0]), float(mean[1]), float(mean[2])), d_matrix)
        for c in range(3):
            d_matrix[4 * c + 3] += d_local[c]


@parallel_kernel
def project_ewa_backward(
    means: np.ndarray,
    quaternions: np.ndarray,
    scales: np.ndarray,
    view: View,
    lens: KernelLens,
    low_pass: float,
    threads: int,
    seen: np.ndarray,
    rows: np.ndarray,
    targets: np.ndarray,
    conics: np.ndarray,
    compensations: np.ndarray,
    d_centres: np.ndarray,
    d_depths: np.ndarray,
    d_conics: np.ndarray,
    d_compensations: np.ndarray,
    d_means: np.ndarray,
    d_quaternions: np.ndarray,
    d_scales: np.ndarray,
    d_matrices: np.ndarray,
) -> None:
    """Gradients with respect to Gaussians and camera, from those with respect to the splats.

    Args:
        means: (N, 3) float32.
        quaternions: (N, 4) float32 of any length.
        scales: (N, 3) float32.
        view: the camera.
        lens: of the camera.
        low_pass: added to both variances on the image.
        threads: number of threads.
        seen: (V,) int64 visible Gaussians, each once.
        rows: (V,) int64 their rows in `conics` and in the gradients of the splats.
        targets: (V,) int64 their rows in the gradients that are written.
        conics: (M, 3) float32 from `project_ewa`.
        compensations: (M,) float32 from `project_ewa`, or (0,) if they have no gradient.
        d_centres: (M, 2) float32 gradient with respect to the centres.
        d_depths: (M,) float32, with respect to the depths.
        d_conics: (M, 3) float32, with respect to the conics.
        d_compensations: (M,) float32, with respect to the compensations, or (0,).
        d_means: (G, 3) float32, added to.
        d_quaternions: (G, 4) float32, added to.
        d_scales: (G, 3) float32, added to.
        d_matrices: (pieces of PIECE of V, MATRIX) float64, added to, or (0, MATRIX) if the camera needs no gradient.
    """
    counter = first_piece()
    for _ in prange(threads):
        piece = take(counter)
        while piece * PIECE < len(seen):
            d_matrix = d_matrices[piece] if len(d_matrices) else np.empty(0)
            for place in range(piece * PIECE, min((piece + 1) * PIECE, len(seen))):
                i, row, target = seen[place], rows[place], targets[place]
                conic = (float(conics[row, 0]), float(conics[row, 1]), float(conics[row, 2]))
                compensation, d_compensation = 1.0, 0.0
                if len(compensations):
                    compensation, d_compensation = float(compensations[row]), float(d_compensations[row])
                d_covariance = _covariance_gradient(conic, d_conics[row], low_pass, compensation, d_compensation)
                _back_one(
                    view, lens, means[i], quaternions[i], scales[i], d_centres[row], d_depths[row], d_covariance,
                    d_means[target], d_quaternions[target], d_scales[target], d_matrix,
                )  # fmt: skip
            piece = take(counter)
