"""Image metrics: PSNR, plain and colour-corrected, SSIM, FLIP, and LPIPS if available."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from itertools import starmap
from typing import NamedTuple

import cv2
import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.metrics.colour_correction import colour_corrected
from pocketgs.metrics.flip import flip
from pocketgs.metrics.perceptual import Lpips
from pocketgs.splat.constants import SSIM_C1, SSIM_C2, SSIM_SIGMA, SSIM_WINDOW

PSNR_CAP = 100.0

MEANS = ("psnr", "cc_psnr", "ssim", "flip", "lpips")
"""The figures in result files."""


class Pair(NamedTuple):
    """A rendering and the photograph that it is compared with.

    Attributes:
        name: the frame's name.
        rendered: (H, W, 3) float RGB; it is clipped to [0, 1], as on a screen.
        photo: (H, W, 3) float RGB in [0, 1].
        mask: (H, W) bool, True for pixels that count, or None for all.
        visible: (H, W) bool, True for pixels that show more than the background, or None for all.
    """

    name: str
    rendered: np.ndarray
    photo: np.ndarray
    mask: np.ndarray | None = None
    visible: np.ndarray | None = None


@dataclass(frozen=True)
class ImageMetrics:
    """The metrics of a rendering.

    Attributes:
        name: the frame's name.
        psnr: in dB, at most 100.
        ssim: 1 for identical images.
        cc_psnr: PSNR in dB after fitting the rendering's colours to the photograph's.
        flip: 0 for identical images, or None if its package is missing.
        lpips: 0 for identical images, or None if it was not computed.
    """

    name: str
    psnr: float
    ssim: float
    cc_psnr: float
    flip: float | None = None
    lpips: float | None = None


@dataclass(frozen=True)
class Evaluation:
    """The metrics of several images, and their means.

    Attributes:
        images: one entry per image, in the order given.
        lpips_note: which LPIPS was computed, or why none was; None if it was not requested.
    """

    images: list[ImageMetrics]
    lpips_note: str | None = None

    @property
    def psnr(self) -> float:
        """Mean PSNR over images in dB, as in published results."""
        return float(np.mean([image.psnr for image in self.images]))

    @property
    def ssim(self) -> float:
        """Mean SSIM over images."""
        return float(np.mean([image.ssim for image in self.images]))

    @property
    def cc_psnr(self) -> float:
        """Mean colour-corrected PSNR over images in dB."""
        return float(np.mean([image.cc_psnr for image in self.images]))

    @property
    def flip(self) -> float | None:
        """Mean FLIP of the images that have one, or None."""
        return _mean_of_known(image.flip for image in self.images)

    @property
    def lpips(self) -> float | None:
        """Mean LPIPS of the images that have one, or None."""
        return _mean_of_known(image.lpips for image in self.images)

    @property
    def means(self) -> dict[str, float | None]:
        """The means by name, as in result files."""
        return {name: getattr(self, name) for name in MEANS}

    def without(self, names: Collection[str]) -> Evaluation | None:
        """The evaluation of the other images, or None if there are none."""
        others = [image for image in self.images if image.name not in names]
        return replace(self, images=others) if others else None


def _mean_of_known(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def evaluate(pairs: Iterable[Pair | tuple], with_lpips: bool = True) -> Evaluation:
    """Compare renderings with photographs.

    Args:
        pairs: each a `Pair`, or a tuple of its first three to five attributes. Consumed one at a time, so a generator
            may render them.
        with_lpips: whether to add LPIPS if its package and weights are available. If not, `Evaluation.lpips_note` says
            why; it is not an error.

    Raises:
        PocketGSError: there are no pairs, or one cannot be compared; the message names it.
    """
    perceptual, note = Lpips.load() if with_lpips else (None, None)
    images = []
    for name, rendered, photo, mask, visible in starmap(Pair, pairs):
        try:
            _check(rendered, photo, mask)
            rendered = np.clip(rendered, 0.0, 1.0)
            metrics = ImageMetrics(
                name,
                psnr(rendered, photo, mask),
                ssim(rendered, photo, mask),
                cc_psnr(rendered, photo, mask, visible),
                flip(rendered, photo, mask),
            )
        except PocketGSError as error:
            raise PocketGSError(f"{name}: {error}") from error
        if perceptual:
            metrics = replace(metrics, lpips=perceptual.distance(rendered, photo, mask))
        images.append(metrics)
    if not images:
        raise PocketGSError("evaluation: no images, expected at least one held-out frame")
    return Evaluation(images, note)


def psnr(rendered: np.ndarray, photo: np.ndarray, mask: np.ndarray | None = None) -> float:
    """Peak signal-to-noise ratio, −10 log10 of the mean squared error over pixels and channels.

    Capped at 100 dB, an error of 1e-5: identical images would give infinity, which JSON does not support.

    Args:
        rendered: (H, W, 3) float RGB in [0, 1].
        photo: (H, W, 3) float RGB in [0, 1].
        mask: (H, W) bool, True where pixels count, or None for all.

    Returns:
        dB.

    Raises:
        PocketGSError: shapes or types disagree, the mask is empty, a number is not finite, or a photograph's is outside
            [0, 1].
    """
    return float(-10 * np.log10(max(squared_error(rendered, photo, mask), 10 ** (-PSNR_CAP / 10))))


def squared_error(rendered: np.ndarray, photo: np.ndarray, mask: np.ndarray | None = None) -> float:
    """Mean squared error over pixels and channels; arguments and errors are those of `psnr`."""
    _check(rendered, photo, mask)
    squared = (rendered.astype(np.float64) - photo) ** 2
    return float(np.mean(squared if mask is None else squared[mask]))


def cc_psnr(
    rendered: np.ndarray, photo: np.ndarray, mask: np.ndarray | None = None, visible: np.ndarray | None = None
) -> float:
    """PSNR of a rendering whose colours have been fitted to the photograph's; see `colour_correction`.

    Around an object that was cut out colours stay: the background has no exposure.

    Args:
        rendered: (H, W, 3) float RGB in [0, 1].
        photo: (H, W, 3) float RGB in [0, 1].
        mask: (H, W) bool, True where pixels count, or None for all.
        visible: (H, W) bool, True for pixels that show more than the background, or None for all.

    Raises:
        PocketGSError: shapes or types disagree, the mask is empty, a number is not finite, or a photograph's is outside
            [0, 1].
    """
    _check(rendered, photo, mask)
    _check_of_pixels("visible", visible, photo)
    if visible is None:
        return psnr(colour_corrected(rendered, photo, mask), photo, mask)
    corrected = colour_corrected(rendered, photo, visible if mask is None else visible & mask)
    return psnr(np.where(visible[..., None], corrected, rendered), photo, mask)


def ssim(rendered: np.ndarray, photo: np.ndarray, mask: np.ndarray | None = None) -> float:
    """Mean structural similarity (Wang, Bovik, Sheikh and Simoncelli, 2004), averaged over the three channels.

    Windows are Gaussian, 11x11 with σ = 1.5; only pixels whose window is inside the image count. This equals
    scikit-image's `structural_similarity` with gaussian_weights=True, sigma=1.5, use_sample_covariance=False and
    data_range=1.

    Args:
        rendered: (H, W, 3) float RGB in [0, 1].
        photo: (H, W, 3) float RGB in [0, 1].
        mask: (H, W) bool, True for pixels that count, or None for all. The similarity map is averaged over them, and
            other pixels have zero weight in windows.

    Returns:
        A number in [−1, 1], 1 for identical images.

    Raises:
        PocketGSError: shapes or types disagree, the mask is empty, a side is shorter than 11 pixels, a number is not
            finite, or a photograph's is outside [0, 1].
    """
    _check(rendered, photo, mask)
    height, width = photo.shape[:2]
    if min(height, width) < SSIM_WINDOW:
        raise PocketGSError(f"SSIM of an image of {width}x{height} pixels, expected at least {SSIM_WINDOW} a side")
    border = SSIM_WINDOW // 2
    inner = (slice(border, height - border), slice(border, width - border))
    similarity = _similarity_map(rendered.astype(np.float64), photo.astype(np.float64), mask)[inner]
    if mask is None:
        return float(similarity.mean())
    if not mask[inner].any():
        raise PocketGSError(f"SSIM: no pixel of the mask lies {border} pixels or more inside the image")
    return float(similarity[mask[inner]].mean())


def _similarity_map(first: np.ndarray, second: np.ndarray, mask: np.ndarray | None) -> np.ndarray:
    """(H, W, 3) SSIM of the windows around each pixel; the names are those of the paper's equation 13."""
    mean_1, mean_2 = _window_mean(first, mask), _window_mean(second, mask)
    variance_1 = _window_mean(first * first, mask) - mean_1**2
    variance_2 = _window_mean(second * second, mask) - mean_2**2
    covariance = _window_mean(first * second, mask) - mean_1 * mean_2
    numerator = (2 * mean_1 * mean_2 + SSIM_C1) * (2 * covariance + SSIM_C2)
    return numerator / ((mean_1**2 + mean_2**2 + SSIM_C1) * (variance_1 + variance_2 + SSIM_C2))


def _window_mean(image: np.ndarray, mask: np.ndarray | None) -> np.ndarray:
    """Mean over the window around each pixel; with a mask, over the pixels that count."""
    if mask is None:
        return _blurred(image)
    share = _blurred(mask.astype(np.float64))
    return _blurred(image * mask[:, :, None]) / np.where(mask, share, 1.0)[:, :, None]


def _blurred(image: np.ndarray) -> np.ndarray:
    return cv2.GaussianBlur(image, (SSIM_WINDOW, SSIM_WINDOW), SSIM_SIGMA)


def _check(rendered: np.ndarray, photo: np.ndarray, mask: np.ndarray | None) -> None:
    for label, image in (("rendered image", rendered), ("photo", photo)):
        if image.ndim != 3 or image.shape[2] != 3 or image.size == 0:
            raise PocketGSError(f"{label} has shape {image.shape}, expected (height, width, 3)")
        if image.dtype.kind != "f":
            raise PocketGSError(f"{label} has type {image.dtype}, expected floating point in [0, 1]")
        if not np.isfinite(image).all():
            raise PocketGSError(f"{label} has values that are not finite, expected RGB in [0, 1]")
    if photo.min() < 0 or photo.max() > 1:
        raise PocketGSError(f"photo has values from {photo.min():g} to {photo.max():g}, expected RGB in [0, 1]")
    if rendered.shape != photo.shape:
        raise PocketGSError(f"rendered image has shape {rendered.shape}, the photo {photo.shape}: expected the same")
    _check_of_pixels("mask", mask, photo)
    if mask is not None and not mask.any():
        raise PocketGSError("mask is empty, expected at least one pixel to compare")


def _check_of_pixels(label: str, chosen: np.ndarray | None, photo: np.ndarray) -> None:
    if chosen is not None and (chosen.shape != photo.shape[:2] or chosen.dtype != np.bool_):
        raise PocketGSError(
            f"{label} is {chosen.dtype} of shape {chosen.shape}, expected bool of shape {photo.shape[:2]}"
        )
