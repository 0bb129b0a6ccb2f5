"""Weights from a sorted scene: the share of each Gaussian that is seen, by direction."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pocketgs.capture.even_choice import evenly_chosen
from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import SH_COEFFICIENTS, Gaussians
from pocketgs.scene.spherical_harmonics import basis
from pocketgs.splat.rasterizer import Rasterizer

LEAST_VISIBLE = 1e-3
"""Smaller visible shares count as this one."""

MOST_CAMERAS = 50
"""More cameras than this are thinned out evenly: each takes an image in either way, and few unknowns are fitted."""

STIFFNESS = 0.02
"""Of the fit, as a share of all views' weight: keeps v level where no camera looks from."""

BLOCK = 1 << 14
"""Gaussians that are fitted at a time: the matrices of degree 3 take 2 KB each."""


def visible_shares(
    gaussians: Gaussians, camera: Camera, seen: np.ndarray, summed: Rasterizer
) -> tuple[np.ndarray, np.ndarray]:
    """Share of each Gaussian that a camera sees: Σ α T / Σ α over pixels, in [0, 1], and Σ α, both (N,).

    Args:
        gaussians: the sorted scene.
        camera: that sees it.
        seen: (N,) Σ α T over pixels.
        summed: composites "sum".
    """
    image = summed.forward(gaussians, camera, ("features",), features=np.zeros((len(gaussians), 1)))
    assert image.features is not None
    # The gradient of Σ α f with respect to f.
    found = summed.backward(image, features=np.ones_like(image.features)).features
    assert found is not None
    covered = found[:, 0]
    shares = np.divide(seen, covered, out=np.zeros_like(covered), where=covered > 0.0)
    return np.minimum(shares, 1.0), covered


def fitted_visibility(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    degree: int,
    sorted_: Rasterizer,
    summed: Rasterizer,
    on_count: Callable[[int, int], None] = lambda done, of: None,
) -> np.ndarray:
    """(N, K) harmonics of the logarithm of the visible share, by least squares over cameras.

    With these as v, a sort-free image has in place of each pixel's transmittance its mean over the Gaussian.

    Args:
        gaussians: the sorted scene.
        cameras: of the views.
        degree: of the harmonics.
        sorted_: composites "over".
        summed: composites "sum".
        on_count: called with the number of cameras that are done, and their total.
    """
    chosen = [cameras[place] for place in evenly_chosen(len(cameras), MOST_CAMERAS)]
    looks = []
    for camera, found in zip(chosen, sorted_.contributions(gaussians, chosen), strict=True):
        looks.append((camera.centre, *visible_shares(gaussians, camera, found.summed, summed)))
        on_count(len(looks), len(chosen))
    visibility_sh = np.empty((len(gaussians), SH_COEFFICIENTS[degree]), np.float32)
    for first in range(0, len(visibility_sh), BLOCK):
        block = slice(first, first + BLOCK)
        seen = [(centre, shares[block], covered[block]) for centre, shares, covered in looks]
        visibility_sh[block] = _fitted(gaussians.means[block], seen, visibility_sh.shape[1])
    return visibility_sh


def _fitted(means: np.ndarray, looks: list[tuple[np.ndarray, np.ndarray, np.ndarray]], coefficients: int) -> np.ndarray:
    """(N, K) harmonics that fit what the cameras see of (N, 3) centres: by camera its centre, shares, and Σ α."""
    matrices, sides = np.zeros((len(means), coefficients, coefficients)), np.zeros((len(means), coefficients))
    for centre, all_shares, covered in looks:
        seen = np.flatnonzero(covered)
        offsets, shares = means[seen] - centre, all_shares[seen]
        rows = basis(offsets / np.linalg.norm(offsets, axis=1, keepdims=True), coefficients)
        # Where a Gaussian is all but hidden, it matters little how well.
        weights = np.sqrt(covered[seen]) * (0.05 + np.sqrt(shares))
        weighted = weights[:, None] * rows
        matrices[seen] += weighted[:, :, None] * rows[:, None, :]
        sides[seen] += np.log(np.maximum(shares, LEAST_VISIBLE))[:, None] * weighted
    stiff = STIFFNESS * np.trace(matrices, axis1=1, axis2=2) + 1e-6
    matrices[:, np.arange(1, coefficients), np.arange(1, coefficients)] += stiff[:, None]
    matrices[:, 0, 0] += 1e-6
    return np.linalg.solve(matrices, sides[..., None])[..., 0]
