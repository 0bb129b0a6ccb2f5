"""LPIPS, a perceptual distance, through the optional extra `lpips`.

It needs PyTorch and, the first time, a download of the backbone network's weights. If either is missing, that is
reported, without an error.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from pocketgs.extras import how_to_install

NETWORK = "vgg"
MIN_SIDE = 16


@dataclass(frozen=True)
class Lpips:
    """LPIPS (Zhang et al., 2018) with the VGG network, as in publications on Gaussian splatting.

    Attributes:
        model: an `lpips.LPIPS`.
    """

    model: Any

    @staticmethod
    def load() -> tuple[Lpips | None, str]:
        """Load the network.

        Returns:
            The metric or None, and a note which metric it is or why there is none.
        """
        try:
            lpips = import_module("lpips")
            model = lpips.LPIPS(net=NETWORK, verbose=False)
        except ModuleNotFoundError as error:
            return None, f"LPIPS not computed: {error}; {how_to_install('lpips')}"
        # An incompatible PyTorch, a download and a cache fail each in their own way: none is worth losing PSNR over.
        except Exception as error:
            return None, f"LPIPS not computed: the {NETWORK} network could not be loaded ({error})"
        return Lpips(model.eval()), f"LPIPS version {model.version} with the {NETWORK} network"

    def distance(self, rendered: np.ndarray, photo: np.ndarray, mask: np.ndarray | None = None) -> float | None:
        """LPIPS of two images, 0 for identical ones.

        Args:
            rendered: (H, W, 3) float RGB in [0, 1].
            photo: (H, W, 3) float RGB in [0, 1].
            mask: (H, W) bool; pixels outside it are replaced by the photograph's in both images. None for all.

        Returns:
            The distance, or None if a side is shorter than the 16 pixels that the network needs, or if PyTorch has
            no memory for images of this size: no scene is worth losing for this figure.
        """
        if min(photo.shape[:2]) < MIN_SIDE:
            return None
        if mask is not None:
            rendered = np.where(mask[:, :, None], rendered, photo)
        torch = import_module("torch")
        with torch.no_grad():
            first, second = (
                torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1)[None], dtype=np.float32))
                for image in (rendered, photo)
            )
            try:
                return float(self.model(first, second, normalize=True))
            except RuntimeError:
                return None
