"""The structural similarity of images, with the interface of the package fused_ssim, which exists in CUDA only."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import pad

from pocketgs.errors import PocketGSError
from pocketgs.splat.constants import SSIM_WINDOW
from pocketgs.splat.cpu.dssim import dssim
from pocketgs.torch.arrays import array_of, check_shape, check_tensors, checked_dtype, torch_threads
from pocketgs.torch.unsupported import first_derivative

PADDINGS = ("same", "valid")

_NO_MASK = np.zeros((0, 0), np.bool_)


def fused_ssim(img1: Tensor, img2: Tensor, padding: str = "same", train: bool = True) -> Tensor:
    """Mean SSIM of two batches of images (Wang et al. 2004), with windows of 11 x 11 pixels and a σ of 1.5.

    Args:
        img1: (B, 3, H, W) float32 in [0, 1]. It alone has a gradient, as in the package.
        img2: of the same shape.
        padding: "same" for one window per pixel, with zeros beyond the border; "valid" for windows inside the image.
        train: ignored: there is a gradient if img1 requires one.

    Returns:
        A scalar, the mean over all windows and channels; 1 for equal images.

    Raises:
        PocketGSError: the images differ in shape or type, there is no such padding, or no window fits.
    """
    check_tensors(4, img1=img1, img2=img2)
    if checked_dtype({"img1": img1, "img2": img2}) != torch.float32:
        raise PocketGSError(f"img1: found {img1.dtype}, expected float32")
    check_shape("img1", img1, (-1, 3, -1, -1))
    check_shape("img2", img2, tuple(img1.shape))
    if padding not in PADDINGS:
        raise PocketGSError(f"padding: found {padding!r}, expected {' or '.join(PADDINGS)}")
    if padding == "same":
        border = 4 * (SSIM_WINDOW // 2,)
        img1, img2 = pad(img1, border), pad(img2, border)
    if min(img1.shape[2:]) < SSIM_WINDOW:
        raise PocketGSError(f"img1: found {tuple(img1.shape)}, expected at least {SSIM_WINDOW} pixels for a window")
    similarity: Tensor = Similarity.apply(img1, img2)
    return similarity


class Similarity(torch.autograd.Function):
    """`Similarity.apply(images, photographs)`: mean SSIM over all windows inside (B, 3, H, W) float32 images."""

    @staticmethod
    def forward(ctx: Any, images: Tensor, photographs: Tensor) -> Tensor:
        """The mean, and its gradient for later."""
        threads = torch_threads()
        gradient = np.zeros(images.shape, np.float32)
        losses = np.zeros(images.shape[:3], np.float32)
        # The kernel compares with 8-bit photographs.
        pairs = zip(array_of(images), array_of(255.0 * photographs), gradient, losses, strict=True)
        for image, photograph, own_gradient, own_losses in pairs:
            dssim(image, photograph, _NO_MASK, 1.0, threads, own_gradient, own_losses)
        ctx.save_for_backward(torch.from_numpy(gradient).div_(-len(gradient)))
        return images.new_tensor(1.0 - losses.sum(dtype=np.float64) / len(losses))

    @staticmethod
    @first_derivative
    def backward(ctx: Any, *d_outputs: Tensor) -> tuple[Tensor | None, ...]:
        """The gradient with respect to the images."""
        (gradient,) = ctx.saved_tensors
        return gradient * d_outputs[0], None
