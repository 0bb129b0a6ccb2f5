"""Add up projected Gaussians: a sum and a product at each pixel, which do not depend on any order.

α is what exceeds the cut, α_i = max(0, min(most, o_i exp(-½ dᵀ Σ'⁻¹ d)) - 1/255), so that it is continuous. Composited
front to back, a splat that passes the cut changes a pixel by at most 1/255 of its colour; here it has a weight, which
may be many times that of all other splats of the pixel.
"""

from __future__ import annotations

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.splat.constants import ALPHA_MIN
from pocketgs.splat.limits import TRAINING, Limits
from pocketgs.splat.reference.project import Projection, ProjectionGradient
from pocketgs.splat.reference.rasterize import Raster, no_gradient, set_shape_gradient, splats_in


def add_up(projection: Projection, camera: Camera, background: np.ndarray, limits: Limits = TRAINING) -> Raster:
    """C = Σ c_i α_i + T·background with T = Π (1 - α_i); no pixel is ever full. Arguments as those of `rasterize`."""
    shape = (camera.height, camera.width)
    image, depth, transmittance = np.zeros((*shape, len(background))), np.zeros(shape), np.ones(shape)
    for contribution in splats_in(np.arange(len(projection.means)), projection, camera, limits.most_opaque):
        alpha = _beyond_cut(contribution.alpha)
        image += alpha[..., None] * projection.colours[contribution.index]
        depth += alpha * projection.depths[contribution.index]
        transmittance *= 1.0 - alpha
    return Raster(image + transmittance[..., None] * background, transmittance, depth)


def add_up_backward(
    projection: Projection,
    camera: Camera,
    raster: Raster,
    d_image: np.ndarray,
    d_transmittance: np.ndarray | float = 0.0,
    limits: Limits = TRAINING,
) -> ProjectionGradient:
    """∂L/∂α_i = c_i · ∂L/∂C - T / (1 - α_i) ∂L/∂T. Arguments as those of `rasterize_backward`; background 0."""
    gradient = no_gradient(len(projection.means), d_image.shape[2])
    d_log_transmittance = d_transmittance * raster.transmittance
    for contribution in splats_in(np.arange(len(projection.means)), projection, camera, limits.most_opaque):
        index, drawn = contribution.index, contribution.alpha
        alpha = _beyond_cut(drawn)
        gradient.colours[index] = np.einsum("hw,hwc->c", alpha, d_image)
        d_alpha = d_image @ projection.colours[index] - d_log_transmittance / (1.0 - alpha)
        d_alpha = np.where((alpha > 0.0) & (drawn < limits.most_opaque), d_alpha, 0.0)
        set_shape_gradient(gradient, contribution, projection.conics[index], d_alpha, drawn)
    return gradient


def _beyond_cut(alpha: np.ndarray) -> np.ndarray:
    return np.maximum(alpha - ALPHA_MIN, 0.0)
