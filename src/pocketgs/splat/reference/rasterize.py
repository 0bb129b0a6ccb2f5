"""Composite projected Gaussians front to back, and compute the gradient by replaying the same order."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.splat.backend import Contributions
from pocketgs.splat.constants import ALPHA_MIN, TRANSMITTANCE_MIN
from pocketgs.splat.limits import TRAINING, Limits
from pocketgs.splat.reference.project import Projection, ProjectionGradient


@dataclass(frozen=True)
class Raster:
    """A rendered image.

    Attributes:
        image: (H, W, C) colour, or other channels, over the background.
        transmittance: (H, W) fraction of the background that shows through; alpha is 1 - transmittance.
        depth: (H, W) Σ α_i T_i z_i; divided by alpha, it is the expected depth.
    """

    image: np.ndarray
    transmittance: np.ndarray
    depth: np.ndarray


@dataclass(frozen=True)
class Contribution:
    """One splat on the whole image: offsets (H, W, 2), the Gaussian's values and α, both (H, W)."""

    index: int
    offsets: np.ndarray
    falloff: np.ndarray
    alpha: np.ndarray


def splats_in(order: np.ndarray, projection: Projection, camera: Camera, most_opaque: float) -> Iterator[Contribution]:
    """The visible splats in a given order, with α_i = min(most, o_i exp(-½ dᵀ Σ'⁻¹ d)), 0 where under 1/255."""
    columns, rows = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    pixels = np.stack([columns, rows], axis=-1)
    for index in order[projection.visible[order]]:
        offsets = pixels - projection.means[index]
        exponent = -0.5 * np.einsum("hwi,ij,hwj->hw", offsets, projection.conics[index], offsets)
        falloff = np.exp(exponent)
        alpha = np.minimum(most_opaque, projection.opacities[index] * falloff)
        yield Contribution(index, offsets, falloff, np.where(alpha >= ALPHA_MIN, alpha, 0.0))


def _front_to_back(projection: Projection, camera: Camera, most_opaque: float) -> Iterator[Contribution]:
    return splats_in(np.argsort(projection.depths, kind="stable"), projection, camera, most_opaque)


def _drawn(alpha: np.ndarray, transmittance: np.ndarray, limits: Limits) -> tuple[np.ndarray, np.ndarray]:
    """α where a splat is drawn, otherwise 0, and the transmittance behind it.

    A negative transmittance marks a pixel that has skipped a splat and accepts no more, although it is not full.
    """
    alpha = np.where(transmittance >= TRANSMITTANCE_MIN, alpha, 0.0)
    rest = transmittance - alpha * transmittance
    if not limits.stops_before:
        return alpha, rest
    full = rest <= TRANSMITTANCE_MIN
    return np.where(full, 0.0, alpha), np.where(full, -np.abs(transmittance), rest)


def rasterize(projection: Projection, camera: Camera, background: np.ndarray, limits: Limits = TRAINING) -> Raster:
    """C = Σ c_i α_i T_i + T·background with T_i = Π_{j<i} (1 - α_j) (3DGS, equation 3).

    Args:
        projection: from `project`.
        camera: of the view.
        background: (C,) of each channel.
        limits: of compositing.
    """
    shape = (camera.height, camera.width)
    image, depth, transmittance = np.zeros((*shape, len(background))), np.zeros(shape), np.ones(shape)
    for contribution in _front_to_back(projection, camera, limits.most_opaque):
        alpha, rest = _drawn(contribution.alpha, transmittance, limits)
        weight = alpha * transmittance
        image += weight[..., None] * projection.colours[contribution.index]
        depth += weight * projection.depths[contribution.index]
        transmittance = rest
    transmittance = np.abs(transmittance)
    return Raster(image + transmittance[..., None] * background, transmittance, depth)


def rasterize_backward(
    projection: Projection,
    camera: Camera,
    raster: Raster,
    d_image: np.ndarray,
    d_transmittance: np.ndarray | float = 0.0,
    limits: Limits = TRAINING,
) -> ProjectionGradient:
    """Gradient of the loss with respect to the projected Gaussians.

    With C_in the colour composited behind a splat, C_out = C_in (1 - α) + α c gives ∂L/∂α = T ∂L/∂C · (c - C_in)
    (the PocketGS paper, on operator T). C_in is the final colour minus the replay's sum so far, divided by the
    transmittance behind the splat, so only the final colour is stored.

    Args:
        projection: as in the forward pass.
        camera: as in the forward pass.
        raster: the forward pass's result.
        d_image: (H, W, C) gradient with respect to `raster.image`.
        d_transmittance: (H, W) gradient with respect to `raster.transmittance`, besides that through the background.
        limits: as in the forward pass.
    """
    gradient = no_gradient(len(projection.means), d_image.shape[2])
    transmittance = np.ones(d_image.shape[:2])
    behind = raster.image.copy()
    for contribution in _front_to_back(projection, camera, limits.most_opaque):
        index = contribution.index
        colour = projection.colours[index]
        alpha, rest = _drawn(contribution.alpha, transmittance, limits)
        weight = alpha * transmittance
        behind -= weight[..., None] * colour
        d_alpha = np.sum(d_image * (transmittance[..., None] * colour - behind / (1.0 - alpha)[..., None]), axis=-1)
        # T = Π (1 - α_j): the other factors stay constant.
        d_alpha -= d_transmittance * raster.transmittance / (1.0 - alpha)
        transmittance = rest
        gradient.colours[index] = np.einsum("hw,hwc->c", weight, d_image)
        # α is constant where it is clamped or skipped.
        d_alpha = np.where((alpha > 0.0) & (alpha < limits.most_opaque), d_alpha, 0.0)
        set_shape_gradient(gradient, contribution, projection.conics[index], d_alpha, alpha)
    return gradient


def no_gradient(count: int, channels: int) -> ProjectionGradient:
    """A gradient of zeros."""
    shapes = ((count, 2), (count, 2, 2), (count,), (count, channels), (count, 2))
    return ProjectionGradient(*(np.zeros(shape) for shape in shapes))


def set_shape_gradient(
    gradient: ProjectionGradient, contribution: Contribution, conic: np.ndarray, d_alpha: np.ndarray, alpha: np.ndarray
) -> None:
    """Write the gradient of a splat's opacity, centre and conic, from the (H, W) gradient with respect to its α."""
    index, offsets, d_exponent = contribution.index, contribution.offsets, d_alpha * alpha
    gradient.opacities[index] = np.sum(d_alpha * contribution.falloff)
    gradient.means[index] = conic @ np.einsum("hw,hwi->i", d_exponent, offsets)
    gradient.absolute_means[index] = np.abs(d_exponent[..., None] * (offsets @ conic)).sum(axis=(0, 1))
    gradient.conics[index] = -0.5 * np.einsum("hw,hwi,hwj->ij", d_exponent, offsets, offsets)


def contributions(projection: Projection, camera: Camera) -> tuple[Contributions, np.ndarray]:
    """Contributions of the Gaussians, and the (H, W) median depth.

    The median depth is that of the splat that brings the transmittance below one half, 0 if none does.
    """
    count, shape = len(projection.means), (camera.height, camera.width)
    found = Contributions(pixels=np.zeros(count, int), largest=np.zeros(count), summed=np.zeros(count))
    transmittance, median = np.ones(shape), np.zeros(shape)
    for contribution in _front_to_back(projection, camera, TRAINING.most_opaque):
        index = contribution.index
        alpha = np.where(transmittance >= TRANSMITTANCE_MIN, contribution.alpha, 0.0)
        weight = alpha * transmittance
        found.pixels[index] = np.count_nonzero(alpha)
        found.largest[index], found.summed[index] = weight.max(), weight.sum()
        median[(transmittance >= 0.5) & (transmittance - weight < 0.5)] = projection.depths[index]
        transmittance = transmittance - weight
    return found, median
