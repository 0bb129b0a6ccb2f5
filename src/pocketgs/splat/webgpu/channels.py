"""Images of any number of channels on the GPU: in groups of three, with the transmittance beside the first group."""

from __future__ import annotations

import numpy as np

from pocketgs.splat.webgpu.image_lists import ImageLists
from pocketgs.splat.webgpu.layout import CENTRE_WORDS
from pocketgs.splat.webgpu.rasterizer_passes import GROUP


def in_groups(channels: np.ndarray, first: int = 0) -> np.ndarray:
    """(N, 3 G) float32: (N, C) channels in whole groups, at least one, after `first` zeros."""
    count = first + channels.shape[1]
    values = np.zeros((len(channels), GROUP * max(-(-count // GROUP), 1)), np.float32)
    values[:, first:count] = channels
    return values


def read_image(lists: ImageLists, channels: int, width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """The image that was drawn last: (C, H, W) and its transmittance (H, W)."""
    groups = lists.symbols["channel_groups"]
    pixels = lists.read("image", np.float32, 4 * groups * lists.symbols["pixels"])
    planes = np.moveaxis(pixels.reshape(groups, height, width, 4), 3, 1)
    return planes[:, :GROUP].reshape(GROUP * groups, height, width)[:channels], planes[0, GROUP].copy()


def packed(d_image: np.ndarray, d_transmittance: np.ndarray) -> np.ndarray:
    """(G, H, W, 4) float32: the gradient of each group's channels, and of the transmittance with the first."""
    channels, height, width = d_image.shape
    groups = max(-(-channels // GROUP), 1)
    planes = np.zeros((GROUP * groups, height, width), np.float32)
    planes[:channels] = d_image
    result = np.zeros((groups, height, width, 4), np.float32)
    result[..., :GROUP] = np.moveaxis(planes.reshape(groups, GROUP, height, width), 1, 3)
    result[0, ..., GROUP] = d_transmittance
    return result


def read_channel_gradients(lists: ImageLists, count: int) -> np.ndarray:
    """(N, 4 + 3 G): the gradients of the centres on the image, signed and absolute, then those of the channels."""
    width = CENTRE_WORDS + GROUP * lists.symbols["channel_groups"]
    return lists.read("channel_gradients", np.float32, width * count).reshape(count, width)
