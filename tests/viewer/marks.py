"""A scene whose renderings reveal the camera: coloured marks in a grey cloud."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pocketgs.geometry.camera import Camera, look_at
from pocketgs.scene.gaussians import SH_DC, Gaussians

WIDTH, HEIGHT = 400, 300
UP = np.array([0.0, -1.0, 0.0])
MARKS = {"red": (0.0, -0.2, -1.0), "green": (-1.0, -0.2, 0.0), "blue": (1.0, -0.2, 0.0)}
"""Centres of coloured Gaussians: in front of the target, left and right of it."""


def marked_scene() -> Gaussians:
    """Grey Gaussians of all shapes, whose grey depends on the direction, and three coloured ones."""
    rng, count = np.random.default_rng(3), 300
    grey = rng.uniform(0.1, 0.3, (count, 1)) * np.ones(3)
    sh = np.repeat(rng.normal(0.0, 0.1, (count + 3, 9, 1)), 3, axis=2)
    sh[:, 0] = (np.concatenate([grey, np.eye(3)]) - 0.5) / SH_DC
    sh[count:, 1:] = 0.0
    means = np.concatenate([rng.uniform((-2, -2, 0.5), (2, 2, 4.5), (count, 3)), list(MARKS.values())])
    log_scales = np.log(0.15) + rng.normal(0.0, 0.5, (count + 3, 3))
    log_scales[count:] = np.log(0.1)
    logits = np.concatenate([rng.uniform(-2, 2, count), np.full(3, 5.0)])
    return Gaussians(means, log_scales, rng.normal(0.0, 1.0, (count + 3, 4)), logits, sh)


def cameras_around() -> list[Camera]:
    """Three cameras that look at the marks; their principal points are not the middle."""
    places = [(0.0, 0.0, -4.0), (-1.5, -0.5, -3.6), (1.5, -0.5, -3.6)]
    poses = [look_at(np.array(place), np.zeros(3), UP) for place in places]
    return [Camera(WIDTH, HEIGHT, 330.0, 340.0, 196.3, 152.7, pose) for pose in poses]


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    return -10 * float(np.log10(max(np.mean((a - b) ** 2), 1e-10)))


def marks(picture: np.ndarray, names: Sequence[str] = tuple(MARKS)) -> dict[str, np.ndarray]:
    """Positions of the coloured marks in an image: (x, y) in pixels, weighted by colour."""
    found = {}
    for channel, name in ((channel, name) for channel, name in enumerate(MARKS) if name in names):
        others = np.delete(picture, channel, axis=2).max(axis=2)
        weights = np.clip(picture[..., channel] - others - 0.3, 0, None)
        assert weights.sum() > 2, f"no {name} mark in the picture"
        rows, columns = np.indices(weights.shape)
        found[name] = np.array([(weights * columns).sum(), (weights * rows).sum()]) / weights.sum()
    return found


def size_of(found: dict[str, np.ndarray]) -> float:
    return float(np.linalg.norm(found["blue"] - found["green"]))
