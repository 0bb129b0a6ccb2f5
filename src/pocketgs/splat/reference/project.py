"""Project Gaussians into a camera's image, and the gradient with respect to the Gaussians."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pocketgs.geometry import lens as lenses
from pocketgs.geometry.camera import Camera
from pocketgs.geometry.quaternions import rotation_matrices
from pocketgs.scene.spherical_harmonics import basis, basis_gradient
from pocketgs.splat.constants import (
    ALPHA_MIN,
    BRIGHTEST,
    LOW_PASS,
    MAX_VARIANCE,
    MIN_DETERMINANT,
)
from pocketgs.splat.near_plane import near_plane
from pocketgs.splat.reference.lenses import is_beside, linearised
from pocketgs.splat.reference.scene import Scene, SceneGradient


@dataclass(frozen=True)
class Projection:
    """Projected Gaussians, in canonical order.

    Attributes:
        means: (N, 2) centres in pixels.
        conics: (N, 2, 2) inverse covariances in 1/pixels².
        opacities: (N,) in (0, 1), after compensation.
        compensations: (N,) factors on the opacities, 1 unless anti-aliased.
        colours: (N, C) RGB, or other channels to composite.
        radii: (N, 2) half the width and height, in pixels, of the region with α of at least 1/255.
        depths: (N,) that splats are sorted by, see `Camera.depths`.
        visible: (N,) whether the Gaussian is drawn.
    """

    means: np.ndarray
    conics: np.ndarray
    opacities: np.ndarray
    compensations: np.ndarray
    colours: np.ndarray
    radii: np.ndarray
    depths: np.ndarray
    visible: np.ndarray


@dataclass(frozen=True)
class ProjectionGradient:
    """Gradient of the loss with respect to a `Projection`'s arrays, of the same shapes; `conics` is symmetric.

    `absolute_means` (N, 2) sums the magnitudes of what pixels add to `means` (AbsGS, Ye et al. 2024, section 3).
    """

    means: np.ndarray
    conics: np.ndarray
    opacities: np.ndarray
    colours: np.ndarray
    absolute_means: np.ndarray


def project(scene: Scene, camera: Camera, near: float | None = None, antialiased: bool = False) -> Projection:
    """Project every Gaussian: Σ' = J W Σ Wᵀ Jᵀ + 0.3 I (3DGS, equation 5).

    If anti-aliased, opacities are multiplied by √(det(Σ' - 0.3 I) / det Σ'), so that the 0.3 I spreads a Gaussian
    without making it more opaque in all (Mip-Splatting's 2D filter, Yu et al. 2024, section 4.2).

    A Gaussian is not visible if it is nearer than the near plane (by default the scene's), outside the lens's valid
    field, or of an opacity under 1/255; if its parameters are not finite, it is thinner than float32 can represent, or
    its bounds at that opacity contain no pixel centre; or if it is beside the image and reaches the camera's plane
    within a standard deviation: its image is no ellipse, and the linearised projection would draw it as a veil.
    """
    with np.errstate(all="ignore"):
        rotation, translation = camera.world_to_camera[:3, :3], camera.world_to_camera[:3, 3]
        local = scene.means @ rotation.T + translation
        axes = rotation_matrices(scene.quaternions) * np.exp(scene.log_scales)[:, None, :]
        footprint = linearised(local, camera).jacobian @ rotation @ axes
        sharp = footprint @ np.swapaxes(footprint, 1, 2)
        covariances = sharp + LOW_PASS * np.eye(2)
        compensations = np.ones(len(scene.means))
        if antialiased:
            compensations = np.sqrt(np.maximum(np.linalg.det(sharp), 0.0) / np.linalg.det(covariances))
        opacities = compensations / (1.0 + np.exp(-scene.opacity_logits))
        # α is 1/255 where dᵀ Σ'⁻¹ d = 2 ln(255 o).
        reach = np.sqrt(np.maximum(2.0 * np.log(opacities / ALPHA_MIN), 0.0))
        radii = reach[:, None] * np.sqrt(np.stack([covariances[:, 0, 0], covariances[:, 1, 1]], axis=1))
        focal, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
        means = lenses.project(camera.lens, local) * focal + centre
        size = np.array([camera.width, camera.height])
        first, last = np.ceil(means - radii - 0.5), np.floor(means + radii - 0.5)
        on_screen = np.all((np.maximum(first, 0) <= np.minimum(last, size - 1)), axis=1)
        directions, _ = _directions(scene, camera)
        colours = np.einsum("nk,nkc->nc", basis(directions, scene.sh.shape[1]), scene.sh) + 0.5
        finite = np.all(np.isfinite(np.concatenate([means, radii], axis=1)), axis=1)
        sound_colour = np.all(np.abs(colours) < BRIGHTEST, axis=1)
        sound_shape = np.linalg.det(covariances) > MIN_DETERMINANT * covariances[:, 0, 0] * covariances[:, 1, 1]
        variances = np.stack([covariances[:, 0, 0], covariances[:, 1, 1]], axis=1)
        depths = lenses.depths(camera.lens, local)
        in_front = depths >= (near_plane(scene.means) if near is None else near)
        in_front &= lenses.shown(camera.lens, local)
        reaching = np.exp(scene.log_scales).max(axis=1) > depths
        in_front &= ~(reaching & is_beside(local, camera))
        sound_shape &= np.all(variances < MAX_VARIANCE, axis=1)
        visible = finite & sound_shape & sound_colour & on_screen & in_front & (opacities >= ALPHA_MIN)
        covariances[~visible] = np.eye(2)
    colours = np.maximum(colours, 0.0)
    conics = np.linalg.inv(covariances)
    return Projection(means, conics, opacities, compensations, colours, radii, depths, visible)


def _directions(scene: Scene, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) unit vectors from the camera to the Gaussians and (N, 1) their distances."""
    offsets = scene.means - camera.centre
    distances = np.linalg.norm(offsets, axis=1, keepdims=True)
    return offsets / distances, distances


def project_backward(
    scene: Scene, camera: Camera, projection: Projection, gradient: ProjectionGradient, antialiased: bool = False
) -> SceneGradient:
    """Gradient of the loss with respect to the scene; zero for Gaussians that are not visible."""
    seen = np.flatnonzero(projection.visible)
    part = scene.select(seen)
    rotation = camera.world_to_camera[:3, :3]
    local = part.means @ rotation.T + camera.world_to_camera[:3, 3]
    lens = linearised(local, camera)

    # Σ' = (Q)⁻¹, so ∂L/∂Σ' = -Q ∂L/∂Q Q.
    conics = projection.conics[seen]
    d_covariance = -conics @ gradient.conics[seen] @ conics
    orientation, scales = rotation_matrices(part.quaternions), np.exp(part.log_scales)
    axes = orientation * scales[:, None, :]
    view = lens.jacobian @ rotation
    footprint = view @ axes
    opacities, compensations = projection.opacities[seen], projection.compensations[seen]
    if antialiased:
        # With S = Σ' - 0.3 I, log √(det S / det Σ') has the derivative ½ (S⁻¹ - Σ'⁻¹).
        sharpened = np.linalg.inv(footprint @ np.swapaxes(footprint, 1, 2)) - conics
        d_covariance += 0.5 * (gradient.opacities[seen] * opacities)[:, None, None] * sharpened
    d_footprint = 2.0 * d_covariance @ footprint
    d_axes = np.swapaxes(view, 1, 2) @ d_footprint
    d_log_scales = np.sum(orientation * d_axes, axis=1) * scales
    # q ← q ⊗ exp(½δ) turns R into R exp([δ]×): the gradient is the skew part of Rᵀ ∂L/∂R.
    skew = np.swapaxes(orientation, 1, 2) @ (d_axes * scales[:, None, :])
    d_rotations = np.stack(
        [skew[:, 2, 1] - skew[:, 1, 2], skew[:, 0, 2] - skew[:, 2, 0], skew[:, 1, 0] - skew[:, 0, 1]], axis=1
    )

    d_jacobian = d_footprint @ np.swapaxes(rotation @ axes, 1, 2)
    d_local = lens.backward(d_jacobian)
    d_local += np.einsum("na,nai->ni", gradient.means[seen], lens.exact)
    d_means = d_local @ rotation

    directions, distances = _directions(part, camera)
    lit = np.einsum("nk,nkc->nc", basis(directions, part.sh.shape[1]), part.sh) + 0.5 > 0.0
    d_colours = gradient.colours[seen] * lit
    d_sh = basis(directions, part.sh.shape[1])[:, :, None] * d_colours[:, None, :]
    d_directions = np.einsum("nki,nkc,nc->ni", basis_gradient(directions, part.sh.shape[1]), part.sh, d_colours)
    # Normalisation removes the component along the direction.
    d_means += (d_directions - directions * np.sum(directions * d_directions, axis=1, keepdims=True)) / distances
    d_logits = gradient.opacities[seen] * opacities * (1.0 - opacities / compensations)
    return SceneGradient.scatter(len(scene.means), seen, d_means, d_log_scales, d_rotations, d_logits, d_sh)
