"""Photometric agreement: how alike two photographs are around a point, under given poses.

Features tell where a point is to a fraction of a pixel, but wrong matches mislead them. The photographs themselves do
not depend on matches: under better poses, the surroundings of a point look more alike in the views that see it.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.prior.features.observations import Observations

RADIUS, STEP = 3, 1.5
"""A patch has 2 RADIUS + 1 samples per side, STEP pixels apart: ten pixels wide."""

MIN_CONTRAST = 4.0
"""Minimum standard deviation of a patch, of 255: below it, noise decides."""

MOST = 10_000
"""Maximum number of observations that are compared, which bounds time and memory; their mean is known well enough."""


def correlations(
    cameras: Sequence[Camera], images: Sequence[np.ndarray], tracks: Observations, points: np.ndarray
) -> np.ndarray:
    """Normalised cross-correlation of each observation's patch with that of the next observation of its track.

    The patch is a plane through the point, parallel to the image of the first view. Each view sees it where its camera
    says, not where its feature is.

    Args:
        cameras: F pinhole cameras.
        images: their (H, W, 3) uint8 images.
        tracks: M observations, sorted by point.
        points: (M, 3) for each observation, the point's position that the track's other observations tell.

    Returns:
        (M,) in [-1, 1]; NaN where a point is unknown, a patch leaves an image or has no contrast.
    """
    found = np.full(len(tracks), np.nan)
    chosen = np.arange(0, len(tracks), max(1, -(-len(tracks) // MOST)))  # the same under any poses
    chosen = chosen[np.isfinite(points[chosen]).all(axis=1)]
    views, sources = tracks.frame[chosen], tracks.frame[_next_of_track(tracks)[chosen]]
    pixels, surface = _patches(cameras, views, points[chosen])
    seen = _sampled(cameras, images, views, pixels)
    found[chosen] = _normalised(seen, _sampled(cameras, images, sources, _projected(cameras, sources, surface)))
    return found


def _next_of_track(tracks: Observations) -> np.ndarray:
    """(M,) index of the next observation of the same track; the first follows the last."""
    following = np.arange(1, len(tracks) + 1)
    starts = np.flatnonzero(np.diff(tracks.point, prepend=-1))
    ends = np.append(starts[1:], len(tracks))[: len(starts)]
    following[ends - 1] = starts
    return following


def _patches(cameras: Sequence[Camera], views: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(M, S, 2) pixels of the samples around each point in its view, and (M, S, 3) their positions in the world."""
    offsets = np.arange(-RADIUS, RADIUS + 1) * STEP
    grid = np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2)
    pixels, surface = np.empty((len(views), len(grid), 2)), np.empty((len(views), len(grid), 3))
    for view in np.unique(views).tolist():
        here, camera = views == view, cameras[view]
        centres, depths = camera.project(points[here])
        pixels[here] = np.where(depths > 0, centres.T, np.nan).T[:, None] + grid
        rays = camera.rays(pixels[here].reshape(-1, 2)).reshape(-1, len(grid), 3)
        surface[here] = camera.centre + rays * depths[:, None, None]
    return pixels, surface


def _projected(cameras: Sequence[Camera], views: np.ndarray, surface: np.ndarray) -> np.ndarray:
    """(M, S, 2) pixels of (M, S, 3) positions, each row in its own view; NaN behind it."""
    pixels = np.empty((*surface.shape[:2], 2))
    for view in np.unique(views).tolist():
        here = views == view
        seen, depths = cameras[view].project(surface[here].reshape(-1, 3))
        pixels[here] = np.where(depths > 0, seen.T, np.nan).T.reshape(pixels[here].shape)
    return pixels


def _sampled(
    cameras: Sequence[Camera], images: Sequence[np.ndarray], views: np.ndarray, pixels: np.ndarray
) -> np.ndarray:
    """(M, S) brightness at the pixels; NaN for patches that are not wholly inside the image."""
    values = np.full(pixels.shape[:2], np.nan, np.float32)
    for view in np.unique(views).tolist():
        here = np.flatnonzero(views == view)
        camera = cameras[view]
        inside = camera.contains(pixels[here].reshape(-1, 2)).reshape(len(here), -1).all(axis=1)
        here = here[inside]
        if not len(here):
            continue
        grey = cv2.cvtColor(images[view], cv2.COLOR_RGB2GRAY).astype(np.float32)
        x, y = np.moveaxis(pixels[here].astype(np.float32) - 0.5, 2, 0)
        values[here] = cv2.remap(grey, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return values


def _normalised(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    first = first - first.mean(axis=1, keepdims=True)
    second = second - second.mean(axis=1, keepdims=True)
    contrasts = np.sqrt((first**2).mean(axis=1)), np.sqrt((second**2).mean(axis=1))
    clear = (contrasts[0] > MIN_CONTRAST) & (contrasts[1] > MIN_CONTRAST)
    product = (first * second).mean(axis=1)
    return np.where(clear, product / np.where(clear, contrasts[0] * contrasts[1], 1.0), np.nan)
