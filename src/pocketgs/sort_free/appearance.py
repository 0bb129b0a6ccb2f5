"""Appearance of Gaussians from a camera, before they are weighted: in NumPy, in any precision.

The engine "reference" uses it as it stands; `kernels.py` has the same in Numba.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.scene.spherical_harmonics import basis
from pocketgs.sort_free.scene import SortFreeScene
from pocketgs.splat.constants import ALPHA_MIN, BRIGHTEST

LEAST_VISIBILITY = -1e30
"""v of Gaussians that are not drawn."""

LEAST_LOGIT = float(np.log(ALPHA_MIN / (1.0 - ALPHA_MIN)))
"""Fainter Gaussians are not drawn by any engine."""


@dataclass(frozen=True)
class Appearance:
    """Appearance of N Gaussians from a camera.

    Attributes:
        drawn: (N,) whether they lie beyond the near plane and hold numbers that can be drawn.
        in_image: (N,) whether they are drawn, with their centres in the image.
        lengths: (N,) distances from the camera, in scene units.
        depths: (N,).
        colours: (N, 3), cut to 0 where negative; 0 if not drawn.
        visibility: (N,) v; `LEAST_VISIBILITY` if not drawn.
        sizes: (N,) largest scales, in the scene's unit; 0 if not drawn.
    """

    drawn: np.ndarray
    in_image: np.ndarray
    lengths: np.ndarray
    depths: np.ndarray
    colours: np.ndarray
    visibility: np.ndarray
    sizes: np.ndarray


def appearance_of(scene: SortFreeScene, camera: Camera, near: float) -> Appearance:
    """Appearance of the Gaussians of depth `near` and more."""
    parameters = scene.gaussians
    kind = parameters.means.dtype
    with np.errstate(all="ignore"):
        depths = camera.depths(parameters.means).astype(kind)
        drawn = np.isfinite(parameters.means).all(axis=1) & (depths >= near)
        directions, lengths = directions_to(scene, camera, drawn)
        harmonics = basis(directions, max(parameters.sh.shape[1], scene.visibility_sh.shape[1]))
        colours = 0.5 + np.einsum("nk,nkc->nc", harmonics[:, : parameters.sh.shape[1]], parameters.sh)
        visibility = np.einsum("nk,nk->n", harmonics[:, : scene.visibility_sh.shape[1]], scene.visibility_sh)
        sizes = np.exp(parameters.log_scales.max(axis=1)) / scene.unit
        drawn &= np.all(np.abs(colours) < BRIGHTEST, axis=1) & np.isfinite(visibility) & np.isfinite(sizes)
        in_image = drawn & (parameters.opacity_logits >= LEAST_LOGIT) & _centre_in_image(parameters.means, camera)
    return Appearance(
        drawn,
        in_image,
        lengths,
        depths,
        np.where(drawn[:, None], np.maximum(colours, 0.0), 0.0).astype(kind),
        np.where(drawn, visibility, LEAST_VISIBILITY).astype(kind),
        np.where(drawn, sizes, 0.0).astype(kind),
    )


def directions_to(scene: SortFreeScene, camera: Camera, drawn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) unit vectors from the camera to the Gaussians, and (N,) distances.

    Gaussians that are not drawn may be at the camera or not finite, so they get an arbitrary finite direction and
    distance.
    """
    means = scene.gaussians.means
    offsets = np.where(drawn[:, None], means - camera.centre, (0.0, 0.0, scene.unit)).astype(means.dtype)
    lengths = np.sqrt(np.einsum("ni,ni->n", offsets, offsets))
    return offsets / lengths[:, None], lengths


def _centre_in_image(means: np.ndarray, camera: Camera) -> np.ndarray:
    pixels, depths = camera.project(means)
    # What a lens does not show has depth 0.
    return (depths > 0.0) & np.all((pixels >= 0.0) & (pixels <= (camera.width, camera.height)), axis=1)
