"""Edits of a scene, as functions from Gaussians to Gaussians: cropping, moving, rotating, scaling, thinning."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.geometry.quaternions import composed
from pocketgs.scene.gaussians import SH_COEFFICIENTS, Gaussians
from pocketgs.scene.spherical_harmonics import basis

SMALLEST, LARGEST = float(np.finfo(np.float32).tiny), float(np.finfo(np.float32).max)
"""Range of float32."""

DIRECTIONS = 64
"""Number of sample directions: many more than the 7 coefficients of degree 3, so the fit is exact up to rounding."""


def cropped(gaussians: Gaussians, low: np.ndarray, high: np.ndarray) -> Gaussians:
    """Keep the Gaussians whose centres lie in a box.

    Args:
        gaussians: the scene.
        low: (3,) smallest coordinates, in scene units.
        high: (3,) largest coordinates.

    Raises:
        PocketGSError: the box is empty.
    """
    if not np.all(np.asarray(low) <= high):
        raise PocketGSError(f"box from {low} to {high}: expected each minimum at most its maximum")
    return gaussians.select(np.all((gaussians.means >= low) & (gaussians.means <= high), axis=1))


def drawable(gaussians: Gaussians) -> Gaussians:
    """Keep the Gaussians whose numbers are finite, but for opacities, which may be 0 or 1.

    Quaternions of length 0 become the identity, which is what they are drawn as: they have no gradient.

    Raises:
        PocketGSError: none is left.
    """
    finite = gaussians.is_finite
    if not finite.any():
        raise PocketGSError("scene: found no Gaussian without NaN or infinity, expected at least one")
    kept = gaussians if finite.all() else gaussians.select(finite)
    without_turn = np.asarray(~kept.quaternions.any(axis=1))
    if not without_turn.any():
        return kept
    identity = np.array([1, 0, 0, 0], np.float32)
    return replace(kept, quaternions=np.where(without_turn[:, None], identity, kept.quaternions))


def without_faint(gaussians: Gaussians, least: float) -> Gaussians:
    """Keep the Gaussians of at least some opacity.

    Raises:
        PocketGSError: `least` is not in [0, 1].
    """
    if not 0.0 <= least <= 1.0:
        raise PocketGSError(f"minimum opacity {least}, expected 0 to 1")
    return gaussians.select(gaussians.opacities >= least)


def with_sh_degree(gaussians: Gaussians, degree: int) -> Gaussians:
    """Set the degree of the spherical harmonics: higher ones are dropped, missing ones become 0.

    Raises:
        PocketGSError: the degree is not 0 to 3.
    """
    if degree not in range(len(SH_COEFFICIENTS)):
        raise PocketGSError(f"spherical harmonics of degree {degree}, expected 0 to {len(SH_COEFFICIENTS) - 1}")
    count = SH_COEFFICIENTS[degree]
    sh = np.zeros((len(gaussians), count, 3), np.float32)
    kept = min(count, gaussians.sh.shape[1])
    sh[:, :kept] = gaussians.sh[:, :kept]
    return replace(gaussians, sh=sh)


def scaled(gaussians: Gaussians, factor: float) -> Gaussians:
    """Scale the scene about the origin.

    Raises:
        PocketGSError: the factor is not positive and finite, or a centre would exceed the range of float32.
    """
    if not SMALLEST <= factor <= LARGEST:
        raise PocketGSError(f"scale {factor}, expected a positive number that scenes can hold (1.2e-38 to 3.4e38)")
    means = gaussians.means.astype(np.float64) * factor
    _check_representable(gaussians.means, means, f"scale {factor:g}")
    return Gaussians(
        means,
        gaussians.log_scales + np.float32(np.log(factor)),
        gaussians.quaternions,
        gaussians.opacity_logits,
        gaussians.sh,
    )


def _check_representable(before: np.ndarray, after: np.ndarray, cause: str) -> None:
    """Check that no coordinate has left the range of float32."""
    largest = float(np.abs(after[np.isfinite(before)]).max(initial=0.0))
    if largest > LARGEST:
        raise PocketGSError(f"{cause}: moves a centre to {largest:.2g}, beyond what scenes can hold (3.4e38)")


def rotated(gaussians: Gaussians, rotation: np.ndarray) -> Gaussians:
    """Rotate the scene about the origin, with its spherical harmonics.

    Args:
        gaussians: the scene.
        rotation: (3, 3), applied to column vectors.

    Raises:
        PocketGSError: the matrix is not a rotation, or a centre would exceed the range of float32.
    """
    rotation = np.asarray(rotation, dtype=np.float64)
    if not np.all(np.isfinite(rotation)) or np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-5:
        raise PocketGSError("rotation: the matrix is not orthonormal")
    if np.linalg.det(rotation) < 0:
        raise PocketGSError("rotation: the matrix mirrors the scene, expected a determinant of +1")
    means = gaussians.means.astype(np.float64) @ rotation.T
    # A coordinate that is none makes the others of its centre the same.
    whole = np.isfinite(gaussians.means).all(axis=1)
    _check_representable(gaussians.means[whole], means[whole], "rotation")
    return Gaussians(
        means,
        gaussians.log_scales,
        composed(_quaternion(rotation), gaussians.unit_quaternions),
        gaussians.opacity_logits,
        np.einsum("ij,njc->nic", sh_rotation(rotation, gaussians.sh.shape[1]), gaussians.sh),
    )


def translated(gaussians: Gaussians, offset: np.ndarray) -> Gaussians:
    """Move the scene by (3,) scene units.

    Raises:
        PocketGSError: the offset is not finite, or a centre would exceed the range of float32.
    """
    if not np.all(np.isfinite(offset)):
        raise PocketGSError(f"translation {offset}, expected finite numbers")
    means = gaussians.means + np.asarray(offset, np.float64)
    _check_representable(gaussians.means, means, f"translation {offset}")
    return Gaussians(
        means,
        gaussians.log_scales,
        gaussians.quaternions,
        gaussians.opacity_logits,
        gaussians.sh,
    )


def sh_rotation(rotation: np.ndarray, coefficients: int) -> np.ndarray:
    """(K, K) matrix that rotates the first K = 1, 4, 9 or 16 coefficients of spherical harmonics.

    A rotated scene shows in direction d what it showed in R⁻¹ d. Harmonics of one degree rotate into each other, so for
    each degree the new coefficients c' follow from Y(d) c' = Y(R⁻¹ d) c in enough directions.
    """
    directions = _even_directions()
    seen, shown = basis(directions, coefficients), basis(directions @ rotation, coefficients)
    turned = np.eye(coefficients)
    for start, stop in pairwise(SH_COEFFICIENTS):
        block = slice(start, min(stop, coefficients))
        turned[block, block] = np.linalg.lstsq(seen[:, block], shown[:, block], rcond=None)[0]
    return turned


def _even_directions() -> np.ndarray:
    """(D, 3) unit vectors on a spiral from pole to pole, about equally spaced."""
    height = (2 * np.arange(DIRECTIONS) + 1) / DIRECTIONS - 1
    angle = np.arange(DIRECTIONS) * np.pi * (3 - np.sqrt(5))
    radius = np.sqrt(1 - height**2)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)


def _quaternion(rotation: np.ndarray) -> np.ndarray:
    """(4,) w, x, y, z of a (3, 3) rotation."""
    # Imported here because SciPy is slow to load.
    from scipy.spatial.transform import Rotation

    return np.roll(Rotation.from_matrix(rotation).as_quat(), 1)
