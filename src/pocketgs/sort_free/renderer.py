"""Sort-free images, and gradients from them back to the scene.

A Gaussian of colour c and weight w goes into the compositor "sum" as the channels (w c, w): it is added up with its α.
By pixel, the sums are divided: see `Form.covers`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.scene.background import checked_background
from pocketgs.scene.spherical_harmonics import basis, basis_gradient
from pocketgs.sort_free.forms import Pullback, Seen
from pocketgs.sort_free.scene import SortFreeScene
from pocketgs.splat.constants import ALPHA_MIN, BRIGHTEST
from pocketgs.splat.near_plane import near_plane
from pocketgs.splat.rasterizer import Raster, RasterGradient, Rasterizer

BLACK = (0.0, 0.0, 0.0)
_LEAST = -1e30
"""v of what is not drawn."""

_LEAST_LOGIT = np.log(ALPHA_MIN / (1.0 - ALPHA_MIN))
"""Fainter Gaussians are not drawn by any engine."""


@dataclass(frozen=True)
class SceneGradient:
    """Gradient with respect to a scene: its Gaussians, its (G,) numbers and its (N, K) views."""

    gaussians: RasterGradient
    numbers: np.ndarray
    views: np.ndarray


@dataclass(frozen=True)
class _Weighted:
    """What Gaussians look like from a camera, and the way back."""

    directions: np.ndarray
    lengths: np.ndarray
    harmonics: np.ndarray
    colours: np.ndarray
    weights: np.ndarray
    depths: np.ndarray
    seen: Seen
    pull: Pullback


@dataclass(frozen=True)
class SortFreeImage:
    """What a camera sees.

    Attributes:
        rgb: (H, W, 3) over the background.
        alpha: (H, W) coverage.
        depth: (H, W) mean depth by weight, Σ α w z / Σ α w, 0 where nothing is; None if it was not asked for.
    """

    rgb: np.ndarray
    alpha: np.ndarray
    depth: np.ndarray | None
    _scene: SortFreeScene
    _camera: Camera
    _behind: np.ndarray
    _weighted: _Weighted
    _raster: Raster
    _totals: np.ndarray


class SortFreeRenderer:
    """Draws scenes without sorting.

    Args:
        engine: as `Rasterizer` takes it, as are the others.
        threads: number of CPU threads.
        gpu: part of the name of the GPU to use.

    Attributes:
        rasterizer: what adds up.
    """

    def __init__(
        self,
        engine: Literal["cpu", "webgpu", "reference"] = "cpu",
        threads: int | None = None,
        gpu: str | None = None,
    ) -> None:
        self.rasterizer = Rasterizer(engine, threads, gpu, "sum")

    def forward(
        self,
        scene: SortFreeScene,
        camera: Camera,
        background: tuple[float, float, float] = BLACK,
        *,
        depth: bool = False,
        near: float | None = None,
    ) -> SortFreeImage:
        """Draw one view.

        Args:
            scene: to draw; not copied, so leave it as it is until `backward` has been called.
            camera: from where.
            background: RGB behind the scene.
            depth: whether to compute the depth.
            near: least depth of the centre of a Gaussian that is drawn; in proportion to the scene if None.
        """
        parameters = scene.gaussians
        near = near_plane(parameters.means) if near is None else near
        weighted = _weigh(scene, camera, near)
        columns = [weighted.colours, np.ones_like(weighted.weights)[:, None]]
        columns += [weighted.depths[:, None]] if depth else []
        channels = weighted.weights[:, None] * np.concatenate(columns, axis=1)
        raster = self.rasterizer.forward(parameters, camera, ("alpha", "features"), features=channels, near=near)
        assert raster.features is not None
        assert raster.alpha is not None
        totals, behind = raster.features, np.array(checked_background(background), raster.features.dtype)
        means = _means(totals)
        if scene.form.covers:
            alpha = np.where(totals[..., 3] > 0.0, raster.alpha, 0.0)
        else:
            alpha = totals[..., 3] / (totals[..., 3] + np.exp(scene.numbers[-1]).astype(totals.dtype))
        rgb = alpha[..., None] * means[..., :3] + (1.0 - alpha)[..., None] * behind
        found = means[..., 4] if depth else None
        return SortFreeImage(rgb, alpha, found, scene, camera, behind, weighted, raster, totals)

    def backward(self, image: SortFreeImage, *, rgb: np.ndarray, depth: np.ndarray | None = None) -> SceneGradient:
        """From gradients with respect to an image to those of the scene.

        Args:
            image: what `forward` returned.
            rgb: (H, W, 3) gradient with respect to the colours.
            depth: (H, W) gradient with respect to the depth, if that was asked for.
        """
        scene, weighted, totals = image._scene, image._weighted, image._totals
        means = _means(totals)
        total = totals[..., 3]
        d_means = np.zeros_like(totals)
        d_means[..., :3] = image.alpha[..., None] * rgb
        if depth is not None:
            d_means[..., 4] = depth
        d_alpha = np.sum(rgb * (means[..., :3] - image._behind), axis=-1)
        d_totals = np.divide(d_means, total[..., None], out=np.zeros_like(totals), where=total[..., None] > 0.0)
        d_totals[..., 3] = -np.sum(d_totals * means, axis=-1)
        d_numbers = np.zeros(len(scene.numbers))
        if scene.form.covers:
            d_coverage = np.where(total > 0.0, d_alpha, 0.0)
        else:
            behind = np.exp(scene.numbers[-1])
            d_coverage = None
            d_totals[..., 3] += (d_alpha * behind / (total + behind) ** 2).astype(totals.dtype)
            d_numbers[-1] = -np.sum(d_alpha * total / (total + behind) ** 2) * behind
        found = self.rasterizer.backward(image._raster, features=d_totals, alpha=d_coverage)
        assert found.features is not None
        return _weigh_backward(scene, image._camera, weighted, found, d_numbers)


def _means(totals: np.ndarray) -> np.ndarray:
    """(H, W, C) weighted means of the channels, 0 where nothing is."""
    total = totals[..., 3:4]
    return np.divide(totals, total, out=np.zeros_like(totals), where=total > 0.0)


def _weigh(scene: SortFreeScene, camera: Camera, near: float) -> _Weighted:
    parameters = scene.gaussians
    kind = parameters.means.dtype
    with np.errstate(all="ignore"):
        offsets = (parameters.means - camera.centre).astype(kind)
        depths = camera.depths(parameters.means).astype(kind)
        # What is not drawn must not spoil the others: it may be as near as it likes, or nowhere.
        drawn = np.isfinite(offsets).all(axis=1) & (depths >= near)
        offsets = np.where(drawn[:, None], offsets, np.array([0.0, 0.0, scene.unit], kind))
        lengths = np.sqrt(np.einsum("ni,ni->n", offsets, offsets))
        directions = offsets / lengths[:, None]
        harmonics = basis(directions, max(parameters.sh.shape[1], scene.views.shape[1]))
        colours = 0.5 + np.einsum("nk,nkc->nc", harmonics[:, : parameters.sh.shape[1]], parameters.sh)
        views = np.einsum("nk,nk->n", harmonics[:, : scene.views.shape[1]], scene.views)
        sizes = np.exp(parameters.log_scales.max(axis=1)) / scene.unit
        drawn &= np.all(np.abs(colours) < BRIGHTEST, axis=1) & np.isfinite(views) & np.isfinite(sizes)
        in_image = drawn & (parameters.opacity_logits >= _LEAST_LOGIT) & _centre_in_image(parameters.means, camera)
    colours = np.where(drawn[:, None], np.maximum(colours, 0.0), 0.0).astype(kind)
    seen = Seen(
        lengths / kind.type(scene.unit),
        np.where(drawn, views, _LEAST).astype(kind),
        np.where(drawn, sizes, 0.0).astype(kind),
        in_image,
    )
    weights, pull = scene.form.weigh(seen, np.exp(scene.numbers))
    return _Weighted(directions, lengths, harmonics, colours, np.where(drawn, weights, 0.0), depths, seen, pull)


def _centre_in_image(means: np.ndarray, camera: Camera) -> np.ndarray:
    pixels, depths = camera.project(means)
    # What a lens does not show has depth 0.
    return (depths > 0.0) & np.all((pixels >= 0.0) & (pixels <= (camera.width, camera.height)), axis=1)


def _weigh_backward(
    scene: SortFreeScene, camera: Camera, weighted: _Weighted, found: RasterGradient, d_numbers: np.ndarray
) -> SceneGradient:
    """From the gradient with respect to channels to that of what they were made from; adds to that of the numbers."""
    parameters, d_channels = scene.gaussians, found.features
    assert d_channels is not None
    weights, directions, harmonics = weighted.weights, weighted.directions, weighted.harmonics
    coefficients, views = parameters.sh.shape[1], scene.views.shape[1]
    d_weights = np.einsum("nc,nc->n", d_channels[:, :3], weighted.colours) + d_channels[:, 3]
    d_means = found.means.copy()
    touched = np.any(d_channels != 0.0, axis=1)
    if d_channels.shape[1] > 4:
        depths = np.where(touched, weighted.depths, 0.0)
        d_weights += d_channels[:, 4] * depths
        ways = directions if camera.lens.model == "fisheye" else camera.forward.astype(weights.dtype)
        d_means += (weights * d_channels[:, 4])[:, None] * ways
    back = weighted.pull(d_weights)
    # A colour that was cut to 0 has no gradient.
    d_colours = np.where(weighted.colours > 0.0, weights[:, None] * d_channels[:, :3], 0.0)
    d_sh = harmonics[:, :coefficients, None] * d_colours[:, None, :]
    d_harmonics = np.zeros_like(harmonics)
    d_harmonics[:, :coefficients] = np.einsum("nkc,nc->nk", parameters.sh, d_colours)
    d_harmonics[:, :views] += scene.views * back.views[:, None]
    d_directions = np.einsum("nk,nki->ni", d_harmonics, basis_gradient(directions, harmonics.shape[1]))
    # A unit vector's derivative keeps only what is across it.
    across = d_directions - np.einsum("ni,ni->n", d_directions, directions)[:, None] * directions
    d_means += across / weighted.lengths[:, None] + (back.distances / scene.unit)[:, None] * directions
    d_log_scales = found.log_scales.copy()
    rows, largest = np.arange(len(weights)), parameters.log_scales.argmax(axis=1)
    d_log_scales[rows, largest] += back.sizes * weighted.seen.sizes
    kind = found.means.dtype
    gaussians = replace(
        found, means=d_means.astype(kind), log_scales=d_log_scales, sh=(found.sh + d_sh).astype(kind), features=None
    )
    return SceneGradient(gaussians, d_numbers + back.numbers, harmonics[:, :views] * back.views[:, None])
