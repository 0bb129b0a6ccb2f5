"""Project Gaussians into a view: Σ' = J W Σ Wᵀ Jᵀ + 0.3 I, colours from spherical harmonics, and visibility."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pocketgs.splat.constants import (
    ALPHA_MIN,
    BRIGHTEST,
    CULLED,
    LOW_PASS,
    MAX_VARIANCE,
    MIN_DETERMINANT,
)
from pocketgs.splat.cpu.layout import (
    CLUSTER,
    COLOURS,
    DEPTH,
    EXPONENT_XX,
    EXPONENT_XY,
    EXPONENT_YY,
    LOG2_ALPHA_MIN,
    LOG2_OPACITY,
    MEAN_X,
    MEAN_Y,
    RED,
    SceneArrays,
    View,
)
from pocketgs.splat.cpu.lenses.formulas import centre_of, depth_of, jacobian_at, shows
from pocketgs.splat.cpu.lenses.jacobians import Jacobian, Pair, along
from pocketgs.splat.cpu.lenses.lens import KernelLens
from pocketgs.splat.cpu.spherical_harmonics import sh_basis
from pocketgs.splat.cpu.vectors import Vector, axes_of, scaled, times
from pocketgs.system.compile import inlined, parallel_kernel, part
from pocketgs.system.dealing import first_piece, take

LOG2_E = 1.0 / math.log(2.0)


@inlined
def to_camera(view: View, mean: np.ndarray) -> Vector:
    """Camera-space position of a world point."""
    x, y, z = times(view.rotation, (float(mean[0]), float(mean[1]), float(mean[2])))
    return (x + view.translation[0], y + view.translation[1], z + view.translation[2])


@inlined
def footprint(view: View, jacobian: Jacobian, axis: Vector, scale: float) -> tuple[Vector, Pair]:
    """One axis of the Gaussian in camera space (3 numbers), and projected (2 numbers)."""
    a = times(view.rotation, scaled(axis, scale))
    return a, along(jacobian, a)


@inlined
def sharp_covariance(p: Pair, q: Pair, r: Pair) -> tuple[float, float, float]:
    """Σ' - 0.3 I from the three projected axes: xx, xy and yy of the sum of their outer products with themselves."""
    return (
        p[0] * p[0] + q[0] * q[0] + r[0] * r[0],
        p[0] * p[1] + q[0] * q[1] + r[0] * r[1],
        p[1] * p[1] + q[1] * q[1] + r[1] * r[1],
    )


@inlined
def sharp_determinant(p: Pair, q: Pair, r: Pair) -> float:
    """Det of Σ' - 0.3 I from the three projected axes: the sum of their squared areas, which avoids cancellation."""
    pq, qr, rp = p[0] * q[1] - p[1] * q[0], q[0] * r[1] - q[1] * r[0], r[0] * p[1] - r[1] * p[0]
    return pq * pq + qr * qr + rp * rp


@inlined
def _reaches_a_pixel(centre: float, radius: float, size: int) -> bool:
    first, last = np.ceil(centre - radius - 0.5), np.floor(centre + radius - 0.5)
    return max(first, 0.0) <= min(last, size - 1.0)


@inlined
def _project_shape(
    view: View,
    lens: KernelLens,
    near: float,
    local: Vector,
    log_scale: np.ndarray,
    quaternion: np.ndarray,
    logit: float,
    splat: np.ndarray,
) -> bool:
    """Write a splat's centre, conic, opacity and depth; False if it is not visible."""
    opacity = 1.0 / (1.0 + math.exp(-float(logit)))
    depth = depth_of(view, lens, local)
    if not (depth >= near and opacity >= ALPHA_MIN):
        return False
    scales = math.exp(float(log_scale[0])), math.exp(float(log_scale[1])), math.exp(float(log_scale[2]))
    if not shows(view, lens, local, max(scales)):
        return False
    jacobian = jacobian_at(view, lens, local)
    w, x, y, z = float(quaternion[0]), float(quaternion[1]), float(quaternion[2]), float(quaternion[3])
    axes = axes_of((w, x, y, z))
    _, p = footprint(view, jacobian, axes[0], scales[0])
    _, q = footprint(view, jacobian, axes[1], scales[1])
    _, r = footprint(view, jacobian, axes[2], scales[2])
    xx, xy, yy = sharp_covariance(p, q, r)
    xx, yy = xx + LOW_PASS, yy + LOW_PASS
    mean_x, mean_y = centre_of(view, lens, local)
    determinant = xx * yy - xy * xy
    if view.antialiased:
        opacity *= math.sqrt(sharp_determinant(p, q, r) / determinant)
        if not opacity >= ALPHA_MIN:
            return False
    log2_opacity = math.log2(opacity)
    # On the ellipse dᵀ Σ'⁻¹ d = reach², α is 1/255.
    reach = math.sqrt(max(0.0, 2.0 * (log2_opacity - LOG2_ALPHA_MIN) / LOG2_E))
    radius_x, radius_y = reach * math.sqrt(xx), reach * math.sqrt(yy)
    sound = math.isfinite(mean_x + mean_y) and xx < MAX_VARIANCE and yy < MAX_VARIANCE
    if not (sound and determinant > MIN_DETERMINANT * xx * yy):
        return False
    if not (_reaches_a_pixel(mean_x, radius_x, view.width) and _reaches_a_pixel(mean_y, radius_y, view.height)):
        return False
    splat[MEAN_X], splat[MEAN_Y] = mean_x, mean_y
    splat[EXPONENT_XX] = -0.5 * LOG2_E * yy / determinant
    splat[EXPONENT_XY] = LOG2_E * xy / determinant
    splat[EXPONENT_YY] = -0.5 * LOG2_E * xx / determinant
    splat[LOG2_OPACITY] = log2_opacity
    splat[DEPTH] = depth
    return True


@inlined
def direction_to(view: View, mean: np.ndarray) -> tuple[Vector, float]:
    """Unit vector from the camera to a world point, and its distance."""
    x, y, z = mean[0] - view.centre[0], mean[1] - view.centre[1], mean[2] - view.centre[2]
    distance = math.sqrt(x * x + y * y + z * z)
    return (x / distance, y / distance, z / distance), distance


@inlined
def _unclipped_colour(sh: np.ndarray, basis: np.ndarray, channel: int) -> float:
    """0.5 + Σ_k Y_k sh_k of one channel, before clamping to 0."""
    value = 0.5
    for k in range(sh.shape[0]):
        value += basis[k] * sh[k, channel]
    return value


@part
def _project_range(
    scene: SceneArrays,
    view: View,
    lens: KernelLens,
    near: float,
    first: int,
    end: int,
    splats: np.ndarray,
    depth_keys: np.ndarray,
) -> None:
    """`project` for the Gaussians from `first` up to `end`."""
    basis = np.empty(16)
    depth = np.empty(1, np.float32)
    bits = depth.view(np.uint32)
    for i in range(first, end):
        splat = splats[i]
        local = to_camera(view, scene.means[i])
        depth_keys[i] = CULLED
        log_scale, quaternion, logit = scene.log_scales[i], scene.quaternions[i], scene.opacity_logits[i]
        if _project_shape(view, lens, near, local, log_scale, quaternion, logit, splat):
            sound = True
            if scene.sh.shape[1] > 0:
                (x, y, z), _ = direction_to(view, scene.means[i])
                sh_basis(x, y, z, scene.sh.shape[1], basis)
                for channel in range(COLOURS):
                    colour = _unclipped_colour(scene.sh[i], basis, channel)
                    splat[RED + channel] = max(colour, 0.0)
                    sound = sound and abs(colour) < BRIGHTEST
            if sound:
                depth[0] = splat[DEPTH]
                depth_keys[i] = bits[0]


@parallel_kernel
def project(
    scene: SceneArrays,
    view: View,
    lens: KernelLens,
    near: float,
    clusters: np.ndarray,
    threads: int,
    splats: np.ndarray,
    depth_keys: np.ndarray,
) -> None:
    """Project the Gaussians of some clusters.

    Args:
        scene: the Gaussians. With K = 0, no colours are written.
        view: the camera.
        lens: of the camera.
        near: minimum depth of drawn Gaussians.
        clusters: (M,) int32, clusters that may be in view.
        threads: number of threads.
        splats: (N, FIRST_CHANNEL + C) float32, written where visible.
        depth_keys: (N,) uint32, written in these clusters: the bits of the depth, which have its order, or CULLED.
    """
    counter = first_piece()
    for _ in prange(threads):
        place = take(counter)
        while place < len(clusters):
            first = clusters[place] * CLUSTER
            end = min(first + CLUSTER, len(scene.means))
            _project_range(scene, view, lens, near, first, end, splats, depth_keys)
            place = take(counter)
