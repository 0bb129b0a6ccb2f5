"""Weights of Gaussians in sort-free images: one function per form, with its gradient.

Sorting finds which Gaussians hide others. Without it, a weight depends on one Gaussian alone: on its distance, and on a
number v that depends on the viewing direction.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from pocketgs.errors import PocketGSError

FormName = Literal["direct", "exponential", "lc", "mobile", "visibility"]

LARGEST_EXPONENT = 40.0
"""Exponents are cut here. In float32, a weight e^17 times as large as another leaves nothing of it, so an image can
change only where two Gaussians past the cut cover one pixel; sums, products and their gradients stay finite."""


@dataclass(frozen=True)
class Seen:
    """Inputs of a weight.

    Attributes:
        distances: (N,) from the camera, in the scene's unit.
        visibility: (N,) v, which depends on the viewing direction.
        sizes: (N,) largest scales, in the scene's unit.
        in_image: (N,) whether it is drawn, with its centre in the image.
    """

    distances: np.ndarray
    visibility: np.ndarray
    sizes: np.ndarray
    in_image: np.ndarray


@dataclass(frozen=True)
class WeightGradient:
    """Gradient with respect to a weight's inputs, (N,) each, and to the (G,) logarithms of the shared numbers."""

    distances: np.ndarray
    visibility: np.ndarray
    sizes: np.ndarray
    log_shared: np.ndarray


Pullback = Callable[[np.ndarray], WeightGradient]
"""From the (N,) gradient with respect to weights to that with respect to their inputs."""

Weighting = Callable[[Seen, np.ndarray], tuple[np.ndarray, Pullback]]
"""From the inputs and the form's (G,) positive numbers to (N,) weights, at least 0, and their pullback."""


@dataclass(frozen=True)
class Form:
    """A rule for the weights of sort-free images.

    Attributes:
        name: of the form.
        weigh: computes the weights.
        numbers: names and first values of the numbers that all Gaussians share; they are positive and learned.
        view_start: first value of v, or None where the form has none.
        covers: whether coverage is 1 - T as in sorted images: C = (1 - T) Σ c α w / Σ α w + T c_B. Otherwise the
            background takes part with a weight, the form's last number: C = (c_B w_B + Σ c α w) / (w_B + Σ α w).
    """

    name: FormName
    weigh: Weighting
    numbers: dict[str, float]
    view_start: float | None
    covers: bool


def _direct(seen: Seen, numbers: np.ndarray) -> tuple[np.ndarray, Pullback]:
    """The weight 1 (Hou et al. 2024, Direct)."""
    zero = np.zeros_like(seen.distances)
    return np.ones_like(zero), lambda d_weights: WeightGradient(zero, zero, zero, np.zeros(len(numbers)))


def _exponential(seen: Seen, numbers: np.ndarray) -> tuple[np.ndarray, Pullback]:
    """The weight exp(-σ d^β) (Hou et al. 2024, Exponential)."""
    sigma, beta = numbers[:2].astype(seen.distances.dtype)
    powers = seen.distances**beta
    weights = np.exp(-sigma * powers)

    def pull(d_weights: np.ndarray) -> WeightGradient:
        d_exponents = d_weights * weights
        d_powers = -sigma * d_exponents
        d_beta = np.sum(d_powers * powers * np.log(seen.distances))
        shared = np.zeros(len(numbers))
        shared[:2] = sigma * -np.sum(d_exponents * powers), beta * d_beta
        zero = np.zeros_like(weights)
        return WeightGradient(d_powers * beta * powers / seen.distances, zero, zero, shared)

    return weights, pull


def _linear_correction(seen: Seen, numbers: np.ndarray) -> tuple[np.ndarray, Pullback]:
    """The weight max(0, 1 - d / σ) v (Hou et al. 2024, Linear Correction), v cut to 0 where negative."""
    sigma = numbers[0].astype(seen.distances.dtype)
    nearness, visibility = np.maximum(1.0 - seen.distances / sigma, 0.0), np.maximum(seen.visibility, 0.0)

    def pull(d_weights: np.ndarray) -> WeightGradient:
        d_nearness = np.where(nearness > 0.0, d_weights * visibility, 0.0)
        shared = np.zeros(len(numbers))
        shared[0] = np.sum(d_nearness * seen.distances) / sigma
        d_visibility = np.where(visibility > 0.0, d_weights * nearness, 0.0)
        return WeightGradient(-d_nearness / sigma, d_visibility, np.zeros_like(d_visibility), shared)

    return nearness * visibility, pull


def _mobile(seen: Seen, numbers: np.ndarray) -> tuple[np.ndarray, Pullback]:
    """The weight φ² + φ / d² + exp(s_max / d) (Du et al. 2026, Mobile-GS), φ = max(0, v)."""
    distances, phi = seen.distances, np.maximum(seen.visibility, 0.0)
    exponents = seen.sizes / distances
    near = np.exp(np.minimum(exponents, LARGEST_EXPONENT))
    squares = distances * distances

    def pull(d_weights: np.ndarray) -> WeightGradient:
        d_phi = np.where(phi > 0.0, d_weights * (2.0 * phi + 1.0 / squares), 0.0)
        d_exponents = np.where(exponents < LARGEST_EXPONENT, d_weights * near, 0.0)
        d_distances = -2.0 * d_weights * phi / (squares * distances) - d_exponents * exponents / distances
        return WeightGradient(d_distances, d_phi, d_exponents / distances, np.zeros(len(numbers)))

    return phi * phi + phi / squares + near, pull


def _visibility(seen: Seen, numbers: np.ndarray) -> tuple[np.ndarray, Pullback]:
    """The weight exp(v) / d^σ: v is the logarithm of the transmittance in front, in terms of sorted images."""
    sigma, logarithms = numbers[0].astype(seen.distances.dtype), np.log(seen.distances)
    exponents = seen.visibility - sigma * logarithms
    # A common factor of all weights cancels: the nearest and clearest Gaussians of the image have weights of about 1.
    # One beside the image does not count: all others might fall below the cut.
    shown = exponents[seen.in_image] if seen.in_image.any() else exponents
    exponents = exponents - shown.max(initial=-np.inf)
    weights = np.exp(np.clip(exponents, -LARGEST_EXPONENT, LARGEST_EXPONENT))

    def pull(d_weights: np.ndarray) -> WeightGradient:
        d_exponents = np.where(np.abs(exponents) < LARGEST_EXPONENT, d_weights * weights, 0.0)
        shared = np.zeros(len(numbers))
        shared[0] = -sigma * np.sum(d_exponents * logarithms)
        return WeightGradient(-sigma * d_exponents / seen.distances, d_exponents, np.zeros_like(d_exponents), shared)

    return weights, pull


FORMS: dict[str, Form] = {
    form.name: form
    for form in (
        Form("direct", _direct, {"background": 0.02}, None, covers=False),
        Form("exponential", _exponential, {"sigma": 2.0, "beta": 1.0, "background": 0.02}, None, covers=False),
        Form("lc", _linear_correction, {"sigma": 10.0, "background": 0.02}, 1.0, covers=False),
        Form("mobile", _mobile, {}, 1.0, covers=True),
        Form("visibility", _visibility, {"sigma": 8.0}, 0.0, covers=True),
    )
}
assert set(FORMS) == set(get_args(FormName))


def form_named(name: str) -> Form:
    """The form with this name.

    Raises:
        PocketGSError: there is none.
    """
    if name not in FORMS:
        raise PocketGSError(f"sort-free form {name!r}: not known, expected one of {', '.join(FORMS)}")
    return FORMS[name]
