"""Poses that are wrong as a whole: those of other photographs, or in another convention than their file's.

OpenCV's camera axes (x right, y down, z forward) are taken for OpenGL's (x right, y up, z backward), upright
photographs for landscape ones, or camera-to-world transforms for world-to-camera ones. Such poses are consistent, so
that no single one stands out, but the matches of photographs contradict nearly all of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product
from typing import NamedTuple

import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.prior.features.pairs import Pair
from pocketgs.prior.poses.tolerance import widest_tolerance

DOUBTFUL, CLEAR = 0.8, 0.9
"""Share of matches that fit the poses below which other conventions are tried, and that one of them has to reach.

Fern, fox, ns_lego and dtu24 have 0.99 in the right convention and at most 0.49 in a wrong one: that is fern with
inverted poses, since its cameras move sideways. Checked: lego, office and terrace have at least 0.97, and at most 0.32.
A short walk forwards has 0.53 with upright photographs taken for landscape ones.
"""

CONTRADICTED = 0.2
"""Share of matches below which poses say nothing, if no other convention fits."""

MOSTLY, MENDED = 0.5, 0.75
"""Share of matches that fit the given poses below which poses have to be adjusted, and the share that must fit then.

Half of 16 poses displaced by 20 cm leave 0.59, and 0.96 once they are placed anew; two thirds leave 0.82 then. Poses of
another walk around the same cup leave 0.39, and adjusted 0.66, which is fog.
"""

MIN_MATCHES = 500
"""Minimum number of matches that allows a conclusion."""


@dataclass(frozen=True, eq=False)
class Convention:
    """Another way to read a pose.

    Attributes:
        axes: (3, 3) rotation from the stated camera axes to the right ones, which permutes and negates them.
        inverted: whether the stated transform is the inverse of world-to-camera.
    """

    axes: np.ndarray
    inverted: bool

    def applied(self, camera: Camera) -> Camera:
        """The camera with its pose read in this way."""
        turn = np.eye(4)
        turn[:3, :3] = self.axes
        stated = camera.camera_to_world if self.inverted else camera.world_to_camera
        return replace(camera, world_to_camera=turn @ stated)

    def __str__(self) -> str:
        names = ", ".join(("" if row.sum() > 0 else "-") + "xyz"[int(np.abs(row).argmax())] for row in self.axes)
        found = [f"camera axes ({names}) in place of (x, y, z)"] if names != "x, y, z" else []
        if names == "x, -y, -z":
            found = ["OpenGL's camera axes in place of OpenCV's, or the reverse"]
        return " and ".join(found + ["inverted transforms"] * self.inverted)


class MisreadPosesError(PocketGSError):
    """The photographs fit the poses only in another convention.

    Attributes:
        convention: the one that fits.
    """

    def __init__(self, convention: Convention) -> None:
        super().__init__(f"the photographs fit the poses only with {convention}: correct the capture's file")
        self.convention = convention


class Agreement(NamedTuple):
    """The share of matches that fit the given poses, and the number of matches."""

    share: float
    matches: int


def check_convention(
    cameras: Sequence[Camera], positions: Sequence[np.ndarray], matches: Mapping[Pair, np.ndarray]
) -> Agreement:
    """Check that the matches do not contradict the poses as a whole.

    Args:
        cameras: of F views, without lenses.
        positions: of each view's features, (N, 2) pixels.
        matches: verified without poses, see `two_view.match_views`.

    Returns:
        How far the matches fit the poses: a share of 1 if there are too few for a conclusion.

    Raises:
        MisreadPosesError: they fit only in another convention.
        PocketGSError: they fit in none.
    """
    found = sum(map(len, matches.values()))
    if found < MIN_MATCHES:
        return Agreement(1.0, found)
    given = Agreement(_share(cameras, positions, matches), found)
    if given.share >= DOUBTFUL:
        return given
    others = [(_share([one.applied(camera) for camera in cameras], positions, matches), one) for one in _others()]
    most, best = max(others, key=lambda other: other[0])
    if most >= CLEAR:
        raise MisreadPosesError(best)
    if given.share < CONTRADICTED:
        raise _contradicted(given)
    return given


def check_adjusted(
    given: Agreement, cameras: Sequence[Camera], positions: Sequence[np.ndarray], matches: Mapping[Pair, np.ndarray]
) -> None:
    """Check that poses which most matches contradicted fit them once they are adjusted.

    Args:
        given: from `check_convention`.
        cameras: adjusted, or as given if they must stay.
        positions: as there.
        matches: of the views whose poses are used.

    Raises:
        PocketGSError: they do not fit.
    """
    is_clear = sum(map(len, matches.values())) >= MIN_MATCHES
    if given.share < MOSTLY and is_clear and _share(cameras, positions, matches) < MENDED:
        raise _contradicted(given)


def _contradicted(given: Agreement) -> PocketGSError:
    return PocketGSError(
        f"the photographs match each other, but {1 - given.share:.0%} of {given.matches:,} matches contradict the "
        "capture's poses: are poses and focal lengths those of these photographs? Expected poses that fit them, or the "
        "folder of photographs alone, for which poses are computed"
    )


def _others() -> Iterator[Convention]:
    """All conventions but the stated one: 24 ways to name the axes, each as it is and inverted."""
    for order, signs, inverted in product(permutations(range(3)), product((1.0, -1.0), repeat=3), (False, True)):
        axes = np.eye(3)[list(order)] * np.array(signs)[:, None]
        if np.linalg.det(axes) > 0.0 and (inverted or not np.array_equal(axes, np.eye(3))):
            yield Convention(axes, inverted)


def _share(cameras: Sequence[Camera], positions: Sequence[np.ndarray], matches: Mapping[Pair, np.ndarray]) -> float:
    """Share of the matches that fit the poses."""
    tolerance, fitting = widest_tolerance(cameras), 0
    for (first, second), found in matches.items():
        here, there = positions[first][found[:, 0]], positions[second][found[:, 1]]
        fitting += int(_fits(cameras[first], cameras[second], here, there, tolerance).sum())
    return fitting / sum(map(len, matches.values()))


def _fits(first: Camera, second: Camera, here: np.ndarray, there: np.ndarray, tolerance: float) -> np.ndarray:
    """(M,) bool: whether some point in front of both cameras, or at infinity, projects to both (M, 2) pixels."""
    one, other = first.rays(here), second.rays(there)
    fits = _errors(second, second.centre + one, there) < tolerance  # at infinity
    # Where the rays are closest to each other: first.centre + s one and second.centre + t other.
    between = second.centre - first.centre
    squares, products = np.sum(one**2, axis=1), np.sum(one * other, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = squares * np.sum(other**2, axis=1) - products**2
        s = ((one @ between) * np.sum(other**2, axis=1) - (other @ between) * products) / determinant
        t = ((one @ between) * products - (other @ between) * squares) / determinant
        points = 0.5 * (first.centre + s[:, None] * one + second.centre + t[:, None] * other)
        meet = (_errors(first, points, here) < tolerance) & (_errors(second, points, there) < tolerance)
    return np.asarray(fits | (meet & (s > 0.0) & (t > 0.0)))


def _errors(camera: Camera, points: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """(M,) distances in pixels of (M, 3) points' projections from (M, 2) pixels; infinite behind the camera."""
    found, depths = camera.project(points)
    return np.where(depths > 0.0, np.linalg.norm(found - pixels, axis=1), np.inf)
