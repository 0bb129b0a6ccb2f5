"""The loss and the optimiser on their own, for custom training loops around a `Rasterizer`."""

from __future__ import annotations

import math

import numba
import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.rasterizer import RasterGradient
from pocketgs.splat.settings import AdamSettings, LearningRates, LossSettings
from pocketgs.splat.store import ParameterStore
from pocketgs.system.cores import kernel_threads


def photometric_loss(
    rgb: np.ndarray, photo: np.ndarray, settings: LossSettings | None = None, mask: np.ndarray | None = None
) -> tuple[float, np.ndarray]:
    """The loss of a rendered image against its photograph, and its gradient.

    Args:
        rgb: (H, W, 3) float32, rendered.
        photo: (H, W, 3) uint8.
        settings: of the loss; None for 0.8 L1 + 0.2 (1 - SSIM). Images of less than 11 pixels in width or height, which
            no window of SSIM fits, have L1 alone. Regularisers are ignored here.
        mask: (H, W) bool: pixels outside count as equal in SSIM's windows, and have no gradient.

    Returns:
        The loss, and (H, W, 3) float32, its gradient with respect to `rgb`.

    Raises:
        PocketGSError: the images, or the mask and the images, differ in shape, or the photograph is not uint8.
    """
    from pocketgs.splat.cpu.loss import photometric

    if rgb.shape != photo.shape or rgb.shape[2:] != (3,) or photo.dtype != np.uint8:
        found = f"images of {rgb.shape} and {photo.dtype} {photo.shape}"
        raise PocketGSError(f"loss: found {found}, expected (H, W, 3) and uint8 of that shape")
    if mask is not None and np.shape(mask) != photo.shape[:2]:
        raise PocketGSError(f"loss: found a mask of {np.shape(mask)}, expected {photo.shape[:2]}, as the images")
    planes = np.ascontiguousarray(np.moveaxis(rgb, 2, 0), np.float32)
    photo_planes = np.ascontiguousarray(np.moveaxis(photo, 2, 0))
    inside = np.zeros((0, 0), np.bool_) if mask is None else np.array(mask, np.bool_, order="C")
    gradient, row_losses = np.empty_like(planes), np.empty(planes.shape[:2], np.float32)
    threads = kernel_threads(None)
    numba.set_num_threads(threads)
    photometric(planes, photo_planes, inside, settings or LossSettings(), threads, gradient, row_losses)
    return float(row_losses.sum(dtype=np.float64)), np.ascontiguousarray(np.moveaxis(gradient, 0, 2))


class Adam:
    """Adam on Gaussians, with a parametrisation and a learning rate per parameter group.

    Args:
        gaussians: initial scene; copied.
        settings: None for `AdamSettings()`.
    """

    def __init__(self, gaussians: Gaussians, settings: AdamSettings | None = None) -> None:
        self._store = ParameterStore(gaussians)
        self._settings = settings or AdamSettings()
        self._steps = 0

    @property
    def scene(self) -> Gaussians:
        """The current Gaussians, not copied: `step` writes to them."""
        return self._store.scene

    def step(self, gradient: RasterGradient, rates: LearningRates) -> None:
        """Take one step against the gradient.

        Args:
            gradient: from `Rasterizer.backward`.
            rates: step sizes by group; from a recipe, or your own.

        Raises:
            PocketGSError: the gradient is not of as many Gaussians, or of another degree.
        """
        from pocketgs.splat.cpu.adam import update
        from pocketgs.splat.cpu.clusters import Clusters

        store, scene = self._store, self.scene
        parts = (gradient.means, gradient.log_scales, gradient.rotations, gradient.opacity_logits, gradient.sh)
        # A rotation has three numbers, like a position.
        like = (scene.means, scene.log_scales, scene.means, scene.opacity_logits, scene.sh)
        found, expected = [np.shape(part) for part in parts], [array.shape for array in like]
        if found != expected:
            raise PocketGSError(f"adam: found gradients of {found}, expected {expected}")
        rows = [np.reshape(part, (store.count, math.prod(part.shape[1:]))) for part in parts]
        np.concatenate(rows, axis=1, out=store.gradients)
        self._steps += 1
        threads = kernel_threads(None)
        numba.set_num_threads(threads)
        update(
            store, store.layout.rates_by_column(rates), self._settings, self._steps, Clusters(store.count).all, threads
        )
