"""Relocalising cameras with wrong poses against the points that the other views agree on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.prior.features.features import Features
from pocketgs.prior.features.finder import FeatureFinder
from pocketgs.prior.features.pairs import MAX_SIMILAR, Pair, by_pose, likeness
from pocketgs.prior.features.tracks import link, triangulate
from pocketgs.prior.features.two_view import Matches, match_views
from pocketgs.prior.poses.absolute_pose import agreeing, pose_from_points
from pocketgs.prior.poses.consensus import consensus
from pocketgs.prior.poses.refinement import carried_along
from pocketgs.prior.poses.tolerance import MIN_ANGLE

ROUNDS = 3
"""Views that are relocalised in one round help to relocalise others in the next."""

MORE_SIMILAR = 4 * MAX_SIMILAR
"""Number of most similar views that a wrong view is matched with: its neighbours by pose are the wrong ones."""

MIN_FIT = 0.6
"""Minimum share of observations that must agree with a new pose, once the view is matched with its neighbours there."""


class Relocalisation:
    """State while wrong views are relocalised.

    Attributes:
        cameras: of F views; wrong ones get their new poses as these are found.
        matches: of pairs of views; more are added on the way.
        wrong: (F,) bool: not relocalised so far.
    """

    def __init__(
        self,
        cameras: Sequence[Camera],
        features: Sequence[Features],
        matches: Matches,
        wrong: np.ndarray,
        tolerance: float,
        scene_distance: float,
        finder: FeatureFinder,
    ) -> None:
        self.cameras, self.matches, self.wrong = list(cameras), dict(matches), wrong.copy()
        self._given, self._features, self._distance = list(cameras), features, scene_distance
        self._tolerance, self._finder = tolerance, finder

    def run(self) -> None:
        """Relocalise as many views as possible."""
        self._match(self._alike())
        for _ in range(ROUNDS):
            known = self._known_points()
            guesses = {
                view: guess for view in np.flatnonzero(self.wrong).tolist() if (guess := self._guess(view, known))
            }
            for view, guess in guesses.items():
                neighbours = self._neighbours(view, guess)
                self._match(neighbours)
                if (placed := self._confirmed(view, neighbours, known)) is not None:
                    self.cameras[view], self.wrong[view] = placed, False
            if not guesses or not self.wrong.any():
                break

    def _alike(self) -> list[Pair]:
        """Pairs of every wrong view with the most similar other views."""
        rows = likeness(self._features)
        rows[:, self.wrong] = -1.0
        pairs = []
        for view in np.flatnonzero(self.wrong):
            for other in np.argsort(-rows[view], kind="stable")[:MORE_SIMILAR]:
                if rows[view, other] > 0:
                    pairs.append((min(int(view), int(other)), max(int(view), int(other))))
        return pairs

    def _neighbours(self, view: int, guess: Camera) -> list[Pair]:
        """Pairs of the view with its neighbours if it had this pose."""
        right = np.flatnonzero(~self.wrong)
        found = by_pose([guess, *[self.cameras[other] for other in right]], self._distance)
        return [
            (min(view, int(right[second - 1])), max(view, int(right[second - 1])))
            for first, second in found
            if first == 0
        ]

    def _match(self, pairs: Sequence[Pair]) -> None:
        missing = [pair for pair in dict.fromkeys(pairs) if pair not in self.matches]
        found = match_views(self.cameras, self._features, missing, self._finder)
        self.matches |= {pair: found.get(pair, np.zeros((0, 2), np.int64)) for pair in missing}

    def _known_points(self) -> list[np.ndarray]:
        """For each view (N, 3) points of its features that correct views agree on, NaN where there is none."""
        known = [np.full((len(view.pixels), 3), np.nan) for view in self._features]
        right = {pair: found for pair, found in self.matches.items() if not self.wrong[list(pair)].any()}
        tracks, feature = link(self._features, right)
        if not len(tracks):
            return known
        kept = np.flatnonzero(consensus(self.cameras, tracks, self._tolerance, MIN_ANGLE).agrees)
        points = triangulate(self.cameras, tracks.select(kept))
        for view, own in enumerate(known):
            here = kept[tracks.frame[kept] == view]
            own[feature[here]] = points[tracks.point[here]]
        return known

    def _observations(self, view: int, pairs: Sequence[Pair], known: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """(M, 3) points that the view may see, from its matches with correct views, and (M, 2) their pixels."""
        points, pixels = [np.zeros((0, 3))], [np.zeros((0, 2))]
        for first, second in pairs:
            other = second if first == view else first
            if self.wrong[other]:
                continue
            own, theirs = self.matches[first, second].T if first == view else self.matches[first, second].T[::-1]
            points.append(known[other][theirs])
            pixels.append(self._features[view].pixels[own])
        both = np.concatenate([np.concatenate(points), np.concatenate(pixels)], axis=1)
        both = np.unique(both[np.isfinite(both).all(axis=1)], axis=0)
        return both[:, :3], both[:, 3:]

    def _guess(self, view: int, known: list[np.ndarray]) -> Camera | None:
        """A pose candidate for the view: from all its matches, or relative to a view that has been relocalised."""
        placed = pose_from_points(
            self._given[view], *self._observations(view, self._pairs_of(view), known), 2 * self._tolerance
        )
        if placed is not None:
            return placed
        mates = [
            (len(found), second if first == view else first)
            for (first, second), found in self.matches.items()
            if view in (first, second)
        ]
        for _, mate in sorted(mates, reverse=True):
            if not self.wrong[mate] and self.cameras[mate] is not self._given[mate]:
                return carried_along(self._given[view], self._given[mate], self.cameras[mate])
        return None

    def _confirmed(self, view: int, neighbours: Sequence[Pair], known: list[np.ndarray]) -> Camera | None:
        """The pose that is consistent with the view's new neighbours."""
        points, pixels = self._observations(view, neighbours, known)
        placed = pose_from_points(self._given[view], points, pixels, 2 * self._tolerance)
        if placed is None:
            return None
        fits = agreeing(placed, points, pixels, 2 * self._tolerance)
        return placed if fits.mean() >= MIN_FIT else None

    def _pairs_of(self, view: int) -> list[Pair]:
        return [pair for pair in self.matches if view in pair]
