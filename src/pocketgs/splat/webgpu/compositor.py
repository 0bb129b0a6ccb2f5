"""Compositing of splats that are already projected, with gsplat's limits, in compute shaders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.splat.webgpu.channels import in_groups, packed, read_channel_gradients, read_image
from pocketgs.splat.webgpu.compositor_passes import SHAPE_GRADIENT_WORDS, describe_compositor
from pocketgs.splat.webgpu.image_lists import ImageLists
from pocketgs.splat.webgpu.layout import CENTRE_WORDS, SPLAT_WORDS
from pocketgs.splat.webgpu.rasterizer_passes import GROUP, backward_sequence

NOT_DRAWN = -1000.0
"""log2 of the opacity of splats that are not drawn."""


@dataclass(frozen=True, eq=False)
class Splats:
    """Splats on an image.

    Attributes:
        width, height: of the image.
        shapes: (N, 7) float32: centre 2, depth, log2 of the opacity or NOT_DRAWN, and its exponents to base 2 by dx²,
            dx dy and dy².
        keys: (N,) uint32 in the order of the depths.
        channels: (N, C) float32.
    """

    width: int
    height: int
    shapes: np.ndarray
    keys: np.ndarray
    channels: np.ndarray


@dataclass(frozen=True)
class SplatGradient:
    """Gradient with respect to splats, 0 where they are not drawn.

    Attributes:
        centres, absolute_centres: (N, 2): summed over pixels, and summed magnitudes, which are zeros unless requested.
        log_opacities: (N,) with respect to the natural logarithm of the opacities.
        moments: (N, 3) Σ v dx², Σ v dx dy and Σ v dy², with v the gradient of a pixel's ln α.
        channels: (N, C).
    """

    centres: np.ndarray
    absolute_centres: np.ndarray
    log_opacities: np.ndarray
    moments: np.ndarray
    channels: np.ndarray


class SplatCompositor:
    """Sorts splats, lists them for tiles, composites them over black, and goes back.

    The GPU holds one image's lists at a time: threads take turns. Going back from an earlier image draws it again
    first.

    Args:
        gpu: part of the name of the GPU to use, or None for the best.

    Raises:
        PocketGSError: there is no such device, or it lacks something.
    """

    def __init__(self, gpu: str | None = None) -> None:
        self._lists = ImageLists(gpu, describe_compositor)

    def forward(self, splats: Splats) -> tuple[np.ndarray, np.ndarray]:
        """The (C, H, W) image and its transmittance (H, W)."""
        with self._lists.lock:
            self._show(splats)
            return read_image(self._lists, splats.channels.shape[1], splats.width, splats.height)

    def backward(
        self, splats: Splats, d_image: np.ndarray, d_transmittance: np.ndarray, absolute: bool
    ) -> SplatGradient:
        """Gradients with respect to the splats from those with respect to what `forward` returned."""
        count, channels = splats.channels.shape
        with self._lists.lock:
            self._show(splats)
            self._lists.run(backward_sequence(absolute), {"d_image": packed(d_image, d_transmittance)})
            rows = read_channel_gradients(self._lists, count)
            shapes = self._lists.read("shape_gradients", np.float32, SHAPE_GRADIENT_WORDS * count)
        shapes = shapes.reshape(count, SHAPE_GRADIENT_WORDS)
        return SplatGradient(
            centres=rows[:, :2],
            absolute_centres=rows[:, 2:CENTRE_WORDS],
            log_opacities=shapes[:, 0],
            moments=shapes[:, 1:],
            channels=rows[:, CENTRE_WORDS : CENTRE_WORDS + channels],
        )

    def _show(self, splats: Splats) -> None:
        """Draw an image, unless it is the one that was drawn last."""
        if self._lists.holds(splats):
            return
        count = len(splats.keys)
        values = in_groups(splats.channels)
        words = np.zeros((count, SPLAT_WORDS["f32"]), np.float32)
        words[:, : splats.shapes.shape[1]] = splats.shapes
        given = {
            "gaussians": count,
            "capacity": count,
            "coefficients": 0,
            "width": splats.width,
            "height": splats.height,
            "channel_groups": values.shape[1] // GROUP,
            "replay_depth": 0,
        }
        content = {
            "splats": words,
            "depth_keys": splats.keys,
            "channels": values,
            "gaussian_count": np.array([count], np.uint32),
        }
        # The passes know of the camera only the image's size.
        camera = Camera(splats.width, splats.height, 1.0, 1.0, 0.0, 0.0, np.eye(4))
        self._lists.draw(splats, given, camera, 0.0, content)
