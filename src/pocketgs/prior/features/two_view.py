"""Two-view geometry independent of poses: matches that one rigid motion explains."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import cv2
import numba
import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.prior.features.features import Features
from pocketgs.prior.features.finder import FeatureFinder
from pocketgs.prior.features.pairs import Pair

VERIFICATION = 1.5
"""Maximum distance from epipolar lines, in pixels of the images matched."""

MIN_MATCHES = 16
MIN_SHARE = 0.25
"""Minimum number of inlier matches, and minimum share of all: below them, a motion would fit random matches too."""

CONFIDENCE, TRIALS = 0.999, 1000

Matches = dict[Pair, np.ndarray]
"""For each pair of views, (M, 2) int64 indices of features."""


def match_views(
    cameras: Sequence[Camera], features: Sequence[Features], pairs: Sequence[Pair], finder: FeatureFinder
) -> Matches:
    """Match pairs of views and keep what one motion explains. Uses intrinsics only, not poses.

    Args:
        cameras: of F views.
        features: of the views.
        pairs: to match.
        finder: matches them.

    Returns:
        The pairs with matches, in the given order.
    """

    def matched(pair: Pair) -> np.ndarray:
        first, second = pair
        found = finder.match(features[first], features[second])
        here, there = features[first].pixels[found[:, 0]], features[second].pixels[found[:, 1]]
        grain = max(features[first].grain, features[second].grain)
        return found[agreeing(cameras[first], cameras[second], here, there, VERIFICATION * grain)]

    with ThreadPoolExecutor(numba.get_num_threads()) as pool:
        found = list(pool.map(matched, pairs))
    return {pair: matches for pair, matches in zip(pairs, found, strict=True) if len(matches)}


def agreeing(first: Camera, second: Camera, here: np.ndarray, there: np.ndarray, tolerance: float) -> np.ndarray:
    """Inliers of an essential matrix, by RANSAC (OpenCV's USAC).

    Args:
        first: camera with the intrinsics of the first view.
        second: camera with the intrinsics of the second view.
        here: (M, 2) pixels in the first view.
        there: (M, 2) pixels in the second.
        tolerance: distance from epipolar lines in pixels.

    Returns:
        (M,) bool; all False if too few are inliers.
    """
    nothing = np.zeros(len(here), bool)
    if len(here) < MIN_MATCHES:
        return nothing
    focal = float(np.sqrt(np.sqrt(first.fx * first.fy * second.fx * second.fy)))
    one, other = (_normalised(camera, pixels) * focal for camera, pixels in ((first, here), (second, there)))
    matrix = np.diag([focal, focal, 1.0])
    try:
        _, inliers = cv2.findEssentialMat(one, other, matrix, cv2.USAC_FAST, CONFIDENCE, tolerance, maxIters=TRIALS)
    except cv2.error:  # a degenerate sample
        return nothing
    if inliers is None:
        return nothing
    agrees = np.asarray(inliers).ravel() > 0
    return agrees if agrees.sum() >= max(MIN_MATCHES, MIN_SHARE * len(here)) else nothing


def _normalised(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    return (pixels - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
