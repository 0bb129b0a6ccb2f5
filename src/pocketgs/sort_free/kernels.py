"""Numba kernels of sort-free images: the appearance of each Gaussian from the camera, and the division at each pixel.

`appearance.py` and `renderer.py` have the same in NumPy, for the engine "reference".
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pocketgs.geometry.camera import Camera
from pocketgs.sort_free.appearance import LEAST_LOGIT, LEAST_VISIBILITY, Appearance
from pocketgs.sort_free.scene import SortFreeScene
from pocketgs.splat.constants import BRIGHTEST
from pocketgs.splat.cpu.layout import View
from pocketgs.splat.cpu.lenses.formulas import centre_of, depth_of, shows
from pocketgs.splat.cpu.lenses.lens import KernelLens, kernel_lens
from pocketgs.splat.cpu.project import direction_to, to_camera
from pocketgs.splat.cpu.spherical_harmonics import sh_basis
from pocketgs.system.compile import parallel_kernel, part
from pocketgs.system.dealing import PIECE, first_piece, take

CHANNELS = 3


def appearance_of(scene: SortFreeScene, camera: Camera, near: float, threads: int) -> Appearance:
    """Appearance of the Gaussians of depth `near` and more, in float32."""
    parameters, count = scene.gaussians, len(scene)
    seen = Appearance(
        np.empty(count, np.bool_),
        np.empty(count, np.bool_),
        *(np.empty(shape, np.float32) for shape in (count, count, (count, CHANNELS), count, count)),
    )
    _see(
        parameters.means,
        parameters.log_scales,
        parameters.opacity_logits,
        parameters.sh,
        np.ascontiguousarray(scene.visibility_sh, np.float32),
        View.of(camera),
        kernel_lens(camera),
        near,
        float(scene.unit),
        threads,
        seen.drawn,
        seen.in_image,
        seen.lengths,
        seen.depths,
        seen.colours,
        seen.visibility,
        seen.sizes,
    )
    return seen


@parallel_kernel
def _see(
    means: np.ndarray,
    log_scales: np.ndarray,
    opacity_logits: np.ndarray,
    sh: np.ndarray,
    visibility_sh: np.ndarray,
    view: View,
    lens: KernelLens,
    near: float,
    unit: float,
    threads: int,
    drawn: np.ndarray,
    in_image: np.ndarray,
    lengths: np.ndarray,
    depths: np.ndarray,
    colours: np.ndarray,
    visibility: np.ndarray,
    sizes: np.ndarray,
) -> None:
    """Fill in an `Appearance`, of which the last seven arguments are the arrays."""
    counter = first_piece()
    for _ in prange(threads):
        basis = np.empty(16)
        first = take(counter) * PIECE
        while first < len(means):
            for i in range(first, min(first + PIECE, len(means))):
                local = to_camera(view, means[i])
                depth = depth_of(view, lens, local)
                depths[i], lengths[i] = depth, unit
                drawn[i] = in_image[i] = False
                colours[i], visibility[i], sizes[i] = 0.0, LEAST_VISIBILITY, 0.0
                if not (math.isfinite(local[0] + local[1] + local[2]) and depth >= near):
                    continue
                (x, y, z), lengths[i] = direction_to(view, means[i])
                sh_basis(x, y, z, max(sh.shape[1], visibility_sh.shape[1]), basis)
                size = math.exp(max(log_scales[i, 0], log_scales[i, 1], log_scales[i, 2]))
                sound, v = _paint(sh[i], visibility_sh[i], basis, colours[i])
                drawn[i] = sound and math.isfinite(size)
                if not drawn[i]:
                    colours[i] = 0.0
                    continue
                visibility[i], sizes[i] = v, size / unit
                if opacity_logits[i] >= LEAST_LOGIT and shows(view, lens, local, size):
                    across, down = centre_of(view, lens, local)
                    in_image[i] = 0.0 <= across <= view.width and 0.0 <= down <= view.height
            first = take(counter) * PIECE


@part
def _paint(sh: np.ndarray, visibility_sh: np.ndarray, basis: np.ndarray, colour: np.ndarray) -> tuple[bool, float]:
    """Write a Gaussian's colour, cut to 0 where negative; returns whether it can be drawn, and its v."""
    v = 0.0
    for k in range(len(visibility_sh)):
        v += basis[k] * visibility_sh[k]
    sound = math.isfinite(v)
    for channel in range(CHANNELS):
        value = 0.5
        for k in range(len(sh)):
            value += basis[k] * sh[k, channel]
        colour[channel] = max(value, 0.0)
        sound = sound and abs(value) < BRIGHTEST
    return sound, v


@parallel_kernel
def divide(
    totals: np.ndarray,
    covered: np.ndarray,
    behind_weight: float,
    background: np.ndarray,
    threads: int,
    rgb: np.ndarray,
    alpha: np.ndarray,
    depth: np.ndarray,
) -> None:
    """Divide an image's sums by its weights.

    Args:
        totals: (H, W, C) float32 sums of weighted colours, of weights, and, if asked for, of weighted depths.
        covered: (H, W) float32, 1 - T.
        behind_weight: of the background; 0 where it shows as much as T says.
        background: (3,) float32.
        threads: number of threads that share the work.
        rgb: (H, W, 3) float32, written.
        alpha: (H, W) float32, written.
        depth: (H, W) float32, written if there are sums of it.
    """
    counter = first_piece()
    for _ in prange(threads):
        row = take(counter)
        while row < len(alpha):
            for column in range(alpha.shape[1]):
                total = totals[row, column, CHANNELS]
                share = np.float32(0.0)
                inverse = np.float32(0.0)
                if total > 0.0:
                    inverse = np.float32(1.0) / total
                    share = total / (total + behind_weight) if behind_weight > 0.0 else covered[row, column]
                for channel in range(CHANNELS):
                    mean = totals[row, column, channel] * inverse
                    rgb[row, column, channel] = share * mean + (np.float32(1.0) - share) * background[channel]
                alpha[row, column] = share
                if totals.shape[2] > CHANNELS + 1:
                    depth[row, column] = totals[row, column, CHANNELS + 1] * inverse
            row = take(counter)
