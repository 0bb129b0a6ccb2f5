"""The interface between the rasterizer and the engines that composite for it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from pocketgs.geometry.camera import Camera


class Parameters(Protocol):
    """The rendered parameters: `Gaussians`, or any object with these arrays, such as a `ParameterStore`'s scene."""

    means: np.ndarray
    log_scales: np.ndarray
    quaternions: np.ndarray
    opacity_logits: np.ndarray
    sh: np.ndarray


@dataclass(frozen=True)
class Contributions:
    """Contributions of each Gaussian to an image.

    Attributes:
        pixels: (N,) int32, number of pixels that it touches.
        largest: (N,) float32, maximum of α T over pixels.
        summed: (N,) float32, sum of α T over pixels.
    """

    pixels: np.ndarray
    largest: np.ndarray
    summed: np.ndarray


@dataclass(frozen=True)
class Composite:
    """An engine's composited channels, with its state for the backward pass.

    Attributes:
        image: (C, H, W) Σ c_i α_i T_i.
        transmittance: (H, W) fraction of the background that shows through.
        visible: (V,) indices of the Gaussians that are drawn, ascending.
        radii: (V, 2) half the width and height, in pixels, of the region with α of at least 1/255.
        tape: internal to the engine.
    """

    image: np.ndarray
    transmittance: np.ndarray
    visible: np.ndarray
    radii: np.ndarray
    tape: Any


@dataclass(frozen=True)
class CompositeGradient:
    """Gradient with respect to N Gaussians and their channels, 0 where they are not visible.

    Attributes:
        means, log_scales: (N, 3).
        rotations: (N, 3) in the tangent space, q ← q ⊗ exp(½δ).
        opacity_logits: (N,).
        sh: (N, K, 3); zeros if colours were not composited.
        channels: (N, C).
        centres, absolute_centres: (N, 2) with respect to the centres on the image in pixels: summed over pixels, and
            summed magnitudes, which are zeros unless requested.
    """

    means: np.ndarray
    log_scales: np.ndarray
    rotations: np.ndarray
    opacity_logits: np.ndarray
    sh: np.ndarray
    channels: np.ndarray
    centres: np.ndarray
    absolute_centres: np.ndarray


class Backend(Protocol):
    """The operations that an engine implements for a rasterizer."""

    dtype: type[np.floating[Any]]
    """Precision of its computations."""

    def forward(
        self,
        parameters: Parameters,
        camera: Camera,
        near: float,
        colours: bool,
        channels: np.ndarray,
        antialiased: bool = False,
    ) -> Composite:
        """Composite colours (the first three channels), if requested, and the (N, C) channels."""

    def backward(
        self, composite: Composite, d_image: np.ndarray, d_transmittance: np.ndarray, absolute: bool
    ) -> CompositeGradient:
        """Convert gradients with respect to `image` and `transmittance` to gradients of the Gaussians."""

    def inspect(self, composite: Composite) -> tuple[Contributions, np.ndarray]:
        """Contributions of each Gaussian, and the (H, W) median depth, in one pass; see `Raster` in `rasterizer.py`."""

    def contributions(self, parameters: Parameters, cameras: Iterable[Camera], near: float) -> Iterator[Contributions]:
        """Contributions of each Gaussian to each camera's image, in turn."""


def contributions_in_turn(
    backend: Backend, parameters: Parameters, cameras: Iterable[Camera], near: float
) -> Iterator[Contributions]:
    """`Backend.contributions` of backends that gain nothing by drawing several views."""
    no_channels = np.empty((len(parameters.means), 0), backend.dtype)
    for camera in cameras:
        yield backend.inspect(backend.forward(parameters, camera, near, False, no_channels))[0]
