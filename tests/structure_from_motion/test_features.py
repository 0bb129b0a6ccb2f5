"""SIFT features of photographs for structure from motion."""

from __future__ import annotations

import numpy as np
from PIL import Image

from pocketgs.structure_from_motion.features import FEW, find_features


def textured(contrast: float) -> np.ndarray:
    """(480, 640, 3) uint8 around a dark grey, with this share of the full contrast."""
    noise = np.random.default_rng(0).integers(0, 256, (60, 80, 3), dtype=np.uint8)
    image = np.asarray(Image.fromarray(noise).resize((640, 480), Image.Resampling.BICUBIC))
    return np.rint(40 + contrast * (image.astype(np.float64) - 128)).clip(0, 255).astype(np.uint8)


def test_faint_photographs_have_features_in_the_same_places() -> None:
    """At a twentieth of the contrast, as under water, none passes the threshold."""
    clear, faint = (find_features(textured(contrast), 4000) for contrast in (0.3, 0.05))
    assert min(len(clear.keypoints), len(faint.keypoints)) >= FEW
    distances = np.linalg.norm(clear.keypoints[:1000, None, :2] - faint.keypoints[None, :, :2], axis=2)
    assert np.mean(distances.min(axis=1) < 1) > 0.7


def test_plain_photographs_have_none() -> None:
    found = find_features(np.full((240, 320, 3), 77, np.uint8), 4000)
    assert found.keypoints.shape == (0, 4)
    assert found.descriptors.shape == (0, 128)
