"""Sort-free images, and gradients from them back to the scene.

A Gaussian of colour c and weight w goes into the compositor "sum" as the channels (w c, w): it is added up with its α.
By pixel, the sums are divided: see `Form.covers`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numba
import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.scene.background import BLACK, Background, checked_background
from pocketgs.scene.gaussians import Gaussians
from pocketgs.scene.spherical_harmonics import basis, basis_gradient
from pocketgs.sort_free import kernels
from pocketgs.sort_free.appearance import Appearance, appearance_of, directions_to
from pocketgs.sort_free.forms import Pullback, Seen
from pocketgs.sort_free.scene import SortFreeScene
from pocketgs.splat.near_plane import near_plane
from pocketgs.splat.rasterizer import Raster, RasterGradient, Rasterizer
from pocketgs.system.cores import kernel_threads


@dataclass(frozen=True)
class SceneGradient:
    """Gradient with respect to a scene: its Gaussians, its (G,) `log_shared` and its (N, K) `visibility_sh`."""

    gaussians: RasterGradient
    log_shared: np.ndarray
    visibility_sh: np.ndarray


@dataclass(frozen=True)
class _Weighted:
    """Appearance and weights of the Gaussians from a camera, and the weights' pullback."""

    look: Appearance
    weights: np.ndarray
    pull: Pullback


@dataclass(frozen=True)
class SortFreeImage:
    """A sort-free image.

    Attributes:
        rgb: (H, W, 3) over the background.
        alpha: (H, W) coverage.
        depth: (H, W) weighted mean depth, Σ α w z / Σ α w, 0 where nothing is drawn; None unless requested.
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
        engine: as for `Rasterizer`.
        threads: number of CPU threads.
        gpu: part of the name of the GPU to use.

    Attributes:
        rasterizer: computes the sums.
    """

    def __init__(
        self,
        engine: Literal["cpu", "webgpu", "reference"] = "cpu",
        threads: int | None = None,
        gpu: str | None = None,
    ) -> None:
        self.rasterizer = Rasterizer(engine, threads, gpu, "sum")
        self._threads = None if engine == "reference" else kernel_threads(threads)

    def forward(
        self,
        scene: SortFreeScene,
        camera: Camera,
        background: Background = BLACK,
        *,
        depth: bool = False,
        near: float | None = None,
    ) -> SortFreeImage:
        """Draw one view.

        Args:
            scene: to draw; not copied, so do not change it until `backward` has been called.
            camera: of the view.
            background: RGB behind the scene.
            depth: whether to compute the depth.
            near: minimum depth of the centre of a drawn Gaussian; None for the default relative to the scene.
        """
        parameters = scene.gaussians
        near = near_plane(parameters.means) if near is None else near
        if self._threads is None:
            look = appearance_of(scene, camera, near)
        else:
            numba.set_num_threads(self._threads)
            look = kernels.appearance_of(scene, camera, near, self._threads)
        weights, pull = scene.form.weigh(_seen(scene, look), np.exp(scene.log_shared))
        weighted = _Weighted(look, np.where(look.drawn, weights, 0.0).astype(look.colours.dtype), pull)
        raster = self.rasterizer.forward(
            _with_undrawable_transparent(parameters, look, near),
            camera,
            ("alpha", "features"),
            features=_channels(weighted, depth),
            near=near,
        )
        assert raster.features is not None
        assert raster.alpha is not None
        behind = np.array(checked_background(background), raster.features.dtype)
        rgb, alpha, depths = self._divided(scene, raster.features, raster.alpha, behind)
        return SortFreeImage(
            rgb, alpha, depths if depth else None, scene, camera, behind, weighted, raster, raster.features
        )

    def _divided(
        self, scene: SortFreeScene, totals: np.ndarray, covered: np.ndarray, behind: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Colours, coverage and depths of an image, from its sums, 1 - T, and the background."""
        behind_weight = 0.0 if scene.form.covers else float(np.exp(scene.log_shared[-1]))
        if self._threads is not None:
            alpha, depths = np.empty_like(covered), np.zeros_like(covered)
            rgb = np.empty((*covered.shape, 3), np.float32)
            kernels.divide(totals, covered, np.float32(behind_weight), behind, self._threads, rgb, alpha, depths)
            return rgb, alpha, depths
        means, total = _means(totals), totals[..., 3]
        alpha = np.where(total > 0.0, covered if scene.form.covers else total / (total + behind_weight), 0.0)
        rgb = alpha[..., None] * means[..., :3] + (1.0 - alpha)[..., None] * behind
        return rgb, alpha, means[..., -1]

    def backward(self, image: SortFreeImage, *, rgb: np.ndarray, depth: np.ndarray | None = None) -> SceneGradient:
        """Compute gradients with respect to the scene from gradients with respect to an image.

        Args:
            image: what `forward` returned.
            rgb: (H, W, 3) gradient with respect to the colours.
            depth: (H, W) gradient with respect to the depth, if it was requested.
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
        d_log_shared = np.zeros(len(scene.log_shared))
        if scene.form.covers:
            d_coverage = np.where(total > 0.0, d_alpha, 0.0)
        else:
            behind = np.exp(scene.log_shared[-1])
            d_coverage = None
            d_totals[..., 3] += (d_alpha * behind / (total + behind) ** 2).astype(totals.dtype)
            d_log_shared[-1] = -np.sum(d_alpha * total / (total + behind) ** 2) * behind
        found = self.rasterizer.backward(image._raster, features=d_totals, alpha=d_coverage)
        assert found.features is not None
        return _weigh_backward(scene, image._camera, weighted, found, d_log_shared)


def _means(totals: np.ndarray) -> np.ndarray:
    """(H, W, C) weighted means of the channels, 0 where nothing is drawn."""
    total = totals[..., 3:4]
    return np.divide(totals, total, out=np.zeros_like(totals), where=total > 0.0)


def _seen(scene: SortFreeScene, look: Appearance) -> Seen:
    kind = look.lengths.dtype
    return Seen(look.lengths / kind.type(scene.unit), look.visibility, look.sizes, look.in_image)


def _channels(weighted: _Weighted, depth: bool) -> np.ndarray:
    """(N, C) weighted colours, weights, and weighted depths if asked for."""
    look, weights = weighted.look, weighted.weights
    channels = np.empty((len(weights), 5 if depth else 4), weights.dtype)
    np.multiply(look.colours, weights[:, None], out=channels[:, :3])
    channels[:, 3] = weights
    if depth:
        channels[:, 4] = np.where(look.drawn, weights * look.depths, 0.0)
    return channels


def _with_undrawable_transparent(parameters: Gaussians, look: Appearance, near: float) -> Gaussians:
    """Make Gaussians transparent whose colour or weight cannot be drawn; the rasterizer checks only shapes."""
    undrawable = ~look.drawn & (look.depths >= near)
    if not undrawable.any():
        return parameters
    return replace(parameters, opacity_logits=np.where(undrawable, -np.inf, parameters.opacity_logits))


def _weigh_backward(
    scene: SortFreeScene, camera: Camera, weighted: _Weighted, found: RasterGradient, d_log_shared: np.ndarray
) -> SceneGradient:
    """Convert the gradient with respect to channels to that of the scene; adds to `d_log_shared`."""
    parameters, d_channels = scene.gaussians, found.features
    assert d_channels is not None
    weights, look = weighted.weights, weighted.look
    coefficients, of_visibility = parameters.sh.shape[1], scene.visibility_sh.shape[1]
    with np.errstate(all="ignore"):
        directions, lengths = directions_to(scene, camera, look.drawn)
    harmonics = basis(directions, max(coefficients, of_visibility))
    d_weights = np.einsum("nc,nc->n", d_channels[:, :3], look.colours) + d_channels[:, 3]
    d_means = found.means.copy()
    touched = np.any(d_channels != 0.0, axis=1)
    if d_channels.shape[1] > 4:
        depths = np.where(touched, look.depths, 0.0)
        d_weights += d_channels[:, 4] * depths
        ways = directions if camera.lens.model == "fisheye" else camera.forward.astype(weights.dtype)
        d_means += (weights * d_channels[:, 4])[:, None] * ways
    back = weighted.pull(d_weights)
    # A colour that was cut to 0 has no gradient.
    d_colours = np.where(look.colours > 0.0, weights[:, None] * d_channels[:, :3], 0.0)
    d_sh = harmonics[:, :coefficients, None] * d_colours[:, None, :]
    d_harmonics = np.zeros_like(harmonics)
    d_harmonics[:, :coefficients] = np.einsum("nkc,nc->nk", parameters.sh, d_colours)
    d_harmonics[:, :of_visibility] += scene.visibility_sh * back.visibility[:, None]
    d_directions = np.einsum("nk,nki->ni", d_harmonics, basis_gradient(directions, harmonics.shape[1]))
    # A unit vector's derivative keeps only what is across it.
    across = d_directions - np.einsum("ni,ni->n", d_directions, directions)[:, None] * directions
    d_means += across / lengths[:, None] + (back.distances / scene.unit)[:, None] * directions
    d_log_scales = found.log_scales.copy()
    rows, largest = np.arange(len(weights)), parameters.log_scales.argmax(axis=1)
    d_log_scales[rows, largest] += back.sizes * look.sizes
    kind = found.means.dtype
    gaussians = replace(
        found, means=d_means.astype(kind), log_scales=d_log_scales, sh=(found.sh + d_sh).astype(kind), features=None
    )
    return SceneGradient(
        gaussians, d_log_shared + back.log_shared, harmonics[:, :of_visibility] * back.visibility[:, None]
    )
