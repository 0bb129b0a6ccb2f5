"""Detection of wrong poses: cameras whose matches with the others imply another relative motion.

Wrong cameras often come in consistent groups, for example all views of the far side of an object that looks the same
from both sides: see `geometry.agreement`. Views that match the largest group but do not join it are wrong.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pocketgs.geometry.agreement import MIN_SUPPORT, PAIR_FIT, agreeing_groups
from pocketgs.geometry.camera import Camera
from pocketgs.geometry.epipolar import essential_matrix, sampson_distances
from pocketgs.prior.features.features import Features
from pocketgs.prior.features.pairs import Pair
from pocketgs.prior.features.tracks import view_distances

MIN_MATCHES = 32
"""Minimum number of matches with the largest group, for each view of another one, that allows a conclusion.

Views that share nothing, or a repeated pattern, have 16 to 50 matches that some motion explains. Where photographs
are few and far between, correct groups share hardly more: in every fourth photograph of a toy, whose poses are exact,
groups of nine and of three views have 11 and 18 matches with the others for each view. Views that are wrong have
many: six of another toy have 102 each.
"""

NEIGHBOURS = 4
ALIKE_PAIRS = 10
ALIKE_SHARE = 1 / 8
"""The chance that a view matches one of its nearest is measured on other views and theirs: on at least so many pairs,
and this share, of those about as far apart.
"""

MAX_CHANCE = 0.01
MIN_FEATURES = 0.5
"""A view without matches is suspect if that has less than this chance under its pose, and it has at least this share of
the features of its nearest.
"""

MIN_VIEWS = 3
MIN_MAIN = 0.25
"""Minimum number of views of the largest group, and share of all views, for it to decide."""


def contradicted(
    cameras: Sequence[Camera], features: Sequence[Features], matches: Mapping[Pair, np.ndarray], tolerance: float
) -> np.ndarray:
    """(F,) bool: views whose poses contradict those of most others.

    Args:
        cameras: of F views.
        features: of the views.
        matches: verified without poses, see `two_view.match_views`.
        tolerance: maximum distance in pixels from epipolar lines under correct poses.
    """
    total, supporting = np.zeros((2, len(cameras), len(cameras)))
    for (first, second), found in matches.items():
        here, there = features[first].pixels[found[:, 0]], features[second].pixels[found[:, 1]]
        near = sampson_distances(_fundamental_matrix(cameras[first], cameras[second]), here, there) < tolerance
        total[first, second] = total[second, first] = len(found)
        if near.sum() >= PAIR_FIT * len(found):
            supporting[first, second] = supporting[second, first] = len(found)
    group = agreeing_groups(total, supporting)
    largest = np.bincount(group).argmax()
    main = group == largest
    found = np.zeros(len(cameras), bool)
    if main.sum() < max(MIN_VIEWS, MIN_MAIN * len(cameras)):
        return found
    for number in np.unique(group[~main]):
        between = np.ix_(group == number, main)
        least = MIN_MATCHES * np.count_nonzero(group == number)
        if total[between].sum() >= least and supporting[between].sum() < MIN_SUPPORT * total[between].sum():
            found |= group == number
    return found


def unmatched_views(
    cameras: Sequence[Camera], features: Sequence[Features], matches: Mapping[Pair, np.ndarray], scene_distance: float
) -> np.ndarray:
    """(F,) bool: views with features but no matches, though views as far apart as their nearest match each other.

    They show another place than their poses say. Views with few features may just show a blank wall, and where
    photographs are far apart, correct views may match none.

    Args:
        cameras: of F views.
        features: of the views.
        matches: verified without poses.
        scene_distance: typical distance to the scene.
    """
    matched = np.zeros((len(cameras), len(cameras)), bool)
    for first, second in matches:
        matched[first, second] = matched[second, first] = True
    found = np.zeros(len(cameras), bool)
    others = np.flatnonzero(matched.any(axis=1))
    if len(others) <= NEIGHBOURS:
        return found
    counts = np.array([len(view.pixels) for view in features])
    apart = view_distances(cameras, cameras, scene_distance)
    np.fill_diagonal(apart, np.inf)
    nearest = others[np.argsort(apart[:, others], axis=1, kind="stable")[:, :NEIGHBOURS]]
    distances = np.log(np.maximum(np.take_along_axis(apart, nearest, axis=1), np.finfo(float).tiny))
    known, links = distances[others].ravel(), np.take_along_axis(matched, nearest, axis=1)[others].ravel()
    alike = max(ALIKE_PAIRS, int(ALIKE_SHARE * len(known)))
    for view in np.setdiff1d(np.arange(len(cameras)), others):
        order = np.argsort(np.abs(known - distances[view][:, None]), axis=1, kind="stable")[:, :alike]
        chance = np.prod(1.0 - links[order].mean(axis=1))
        found[view] = chance < MAX_CHANCE and counts[view] >= MIN_FEATURES * np.median(counts[nearest[view]])
    return found


def _fundamental_matrix(first: Camera, second: Camera) -> np.ndarray:
    """(3, 3) fundamental matrix from pixels of one pinhole camera to lines of the other."""
    essential = essential_matrix(second.world_to_camera @ first.camera_to_world)
    return np.linalg.inv(second.intrinsic_matrix).T @ essential @ np.linalg.inv(first.intrinsic_matrix)
