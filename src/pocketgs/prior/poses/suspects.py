"""Detection of wrong poses: cameras whose matches with the others imply another relative motion.

Wrong cameras often come in consistent groups, for example all views of the far side of an object that looks the same
from both sides. So views are merged into groups, pairs with most matches first, as long as the matches between two
groups fit their poses. Views that match the largest group but do not join it are wrong.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.prior.features.features import Features
from pocketgs.prior.features.pairs import Pair
from pocketgs.prior.features.tracks import view_distances

PAIR_FIT = 0.8
"""Minimum share of a pair's matches that must fit the poses for the pair to support them.

Of matches that one motion explains, nearly all fit correct poses. Of random matches about half lie near epipolar lines,
since these are long.
"""

MIN_SUPPORT = 1 / 3
"""Minimum share of the matches between two groups that must belong to supporting pairs.

Not higher, since repeated patterns give wrong matches that agree on a motion, even between correct views. Not lower,
since wrong views find partners by chance: of a room with half the poses wrong, three agree with the largest group in
0.31 of their matches. Two correct photographs of a kitchen, with few matches in all, have no more, and are left out.
"""

MIN_MATCHES = 32
"""Minimum number of matches between two groups that allows a conclusion."""

NEIGHBOURS = 4
MIN_FEATURES = 0.5
"""A view without matches is a stranger if it has at least this share of its neighbours' features."""

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
        near = epipolar_distance(cameras[first], cameras[second], here, there) < tolerance
        total[first, second] = total[second, first] = len(found)
        if near.sum() >= PAIR_FIT * len(found):
            supporting[first, second] = supporting[second, first] = len(found)
    group = _groups(sorted(matches), total, supporting)
    largest = np.bincount(group).argmax()
    main = group == largest
    found = np.zeros(len(cameras), bool)
    if main.sum() < max(MIN_VIEWS, MIN_MAIN * len(cameras)):
        return found
    for number in np.unique(group[~main]):
        between = np.ix_(group == number, main)
        if total[between].sum() >= MIN_MATCHES and supporting[between].sum() < MIN_SUPPORT * total[between].sum():
            found |= group == number
    return found


def strangers(
    cameras: Sequence[Camera], features: Sequence[Features], matches: Mapping[Pair, np.ndarray], scene_distance: float
) -> np.ndarray:
    """(F,) bool: views with features but no matches, though views all around them match each other.

    They show another place than their poses say. Views with few features may just show a blank wall.

    Args:
        cameras: of F views.
        features: of the views.
        matches: verified without poses.
        scene_distance: typical distance to the scene.
    """
    matched = np.zeros((len(cameras), len(cameras)), bool)
    for first, second in matches:
        matched[first, second] = matched[second, first] = True
    counts = np.array([len(view.pixels) for view in features])
    apart = view_distances(cameras, cameras, scene_distance)
    np.fill_diagonal(apart, np.inf)
    found = np.zeros(len(cameras), bool)
    for view in np.flatnonzero(~matched.any(axis=1)):
        near = np.argsort(apart[view], kind="stable")[:NEIGHBOURS]
        linked = matched[np.ix_(near, near)]
        reach = apart[np.ix_(near, near)][linked].max(initial=0.0)
        expected = linked.any(axis=1) & (apart[view, near] <= reach)
        found[view] = expected.sum() >= NEIGHBOURS - 1 and counts[view] >= MIN_FEATURES * np.median(counts[near])
    return found


def _groups(pairs: Sequence[Pair], total: np.ndarray, supporting: np.ndarray) -> np.ndarray:
    """(F,) the group of each view."""
    group = np.arange(len(total))
    for first, second in sorted(pairs, key=lambda pair: -supporting[pair]):
        if group[first] == group[second] or not supporting[first, second]:
            continue
        one, other = group == group[first], group == group[second]
        if supporting[np.ix_(one, other)].sum() >= MIN_SUPPORT * total[np.ix_(one, other)].sum():
            group[other] = group[first]
    return group


def epipolar_distance(first: Camera, second: Camera, here: np.ndarray, there: np.ndarray) -> np.ndarray:
    """(M,) Sampson distance in pixels of matches from the epipolar geometry of two cameras (Sampson 1982).

    Args:
        first: one camera.
        second: the other.
        here: (M, 2) pixels in the first image.
        there: (M, 2) pixels in the second.
    """
    relative = second.world_to_camera @ first.camera_to_world
    x, y, z = relative[:3, 3]
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    essential = cross @ relative[:3, :3]
    fundamental = np.linalg.inv(second.intrinsic_matrix).T @ essential @ np.linalg.inv(first.intrinsic_matrix)
    one, other = (np.column_stack([pixels, np.ones(len(pixels))]) for pixels in (here, there))
    lines, other_lines = one @ fundamental.T, other @ fundamental
    slope = np.sum(lines[:, :2] ** 2 + other_lines[:, :2] ** 2, axis=1)
    return np.abs(np.sum(lines * other, axis=1)) / np.sqrt(np.maximum(slope, 1e-30))
