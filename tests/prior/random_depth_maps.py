"""Depth maps at random, to compare."""

from __future__ import annotations

import numpy as np

from pocketgs.geometry.camera import look_at
from pocketgs.prior.depth.consistency import SweptViews


def random_views(seed: int) -> SweptViews:
    """Three views from around of something at a distance of 4, of different sizes.

    Some depths are unknown, and on the left most are noise.
    """
    rng = np.random.default_rng(seed)
    sizes = np.array([[9, 13], [11, 8], [7, 15]])
    depths = rng.choice([0.0, 3.9, 4.0, 4.03, 6.0], (3, 11, 15)).astype(np.float32)
    depths[:, :, 7:] = np.where(rng.random((3, 11, 8)) < 0.7, np.float32(4.0), depths[:, :, 7:])
    poses = [look_at(rng.normal(0, 0.7, 3) - [0, 0, 4], rng.normal(0, 0.2, 3), rng.normal(size=3)) for _ in sizes]
    for depth, (height, width) in zip(depths, sizes, strict=True):
        depth[height:], depth[:, width:] = 4.0, 4.0  # never to be looked at
    intrinsics = np.array([(12.0, 13.0, width / 2, height / 2 + 1) for height, width in sizes])
    rotations, translations = np.array([p[:3, :3] for p in poses]), np.array([p[:3, 3] for p in poses])
    return SweptViews(depths, intrinsics, sizes, rotations, translations, np.array([1e-4, 0.005, 0.001]))


def with_copy(views: SweptViews, apart: float) -> SweptViews:
    """The same, but the second view looks as the first does, from a place beside it."""
    rotations, translations = views.rotations.copy(), views.translations.copy()
    rotations[1], translations[1] = rotations[0], translations[0] + [apart, 0, 0]
    return views._replace(rotations=rotations, translations=translations)
