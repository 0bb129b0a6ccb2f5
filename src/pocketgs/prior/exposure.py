"""Exposure: the gains between photographs of the same surfaces, and photographs brought to their mean."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.prior.features.observations import enough_for_each_view
from pocketgs.prior.features.tracks import view_distances
from pocketgs.prior.poses.structure import Structure
from pocketgs.prior.scale import Scale

DARKEST, BRIGHTEST = 8.0, 247.0
"""Grey levels between which a pixel tells of its exposure: noise lies below, and above what a sensor cuts off."""

SMOOTHING = 1.5
"""Standard deviation in pixels of the blur under which colours are compared: poses and noise then matter little."""

BLUR_RADIUS = int(2 * SMOOTHING)
ALTERNATIONS = 20
SETTLED = 1e-4
"""Maximum number of turns in which colours of points and gains are estimated. They have settled, and turns end, once no
gain changes by more than this share.
"""

MIN_POINTS = 50
ENOUGH_POINTS = 200
"""Number of points of each view that are measured: more take time, and do not change the median."""

MOST_POINTS = 10 * ENOUGH_POINTS
"""Maximum number of points measured per photograph. One that sees all of a large scene would measure the points of all
other photographs otherwise.
"""

NEIGHBOURS = 3
"""Number of most similar views, whose points a photograph is taken to see."""

MIN_VARIATION = 0.02
"""Exposures that vary by less are left as they are."""

PREDICTABLE = 0.7
"""Exposures are left as they are where similar views tell a view's exposure to within this share of its variation.

Training absorbs slow changes: what is rendered for a view looks like the photographs taken near it.
"""


def exposure_gains(frames: Sequence[Frame], structure: Structure, scale: Scale) -> np.ndarray:
    """How bright each photograph is, measured on points that several of them see.

    The logarithm of a colour is taken as that of the point plus that of the photograph's gain; medians, taken in turns,
    separate the two.

    Args:
        frames: F photographs with poses.
        structure: the points that they see.
        scale: of the scene.

    Returns:
        (F, 3) factor on red, green and blue of each, with a geometric mean of 1. One that sees too few points has that
        of the most similar view; 1 for all where fewer than two see enough.
    """
    seen = _samples(frames, structure, scale)
    enough = np.bincount(seen.frame, minlength=len(frames)) >= MIN_POINTS
    if np.count_nonzero(enough) < 2:
        return np.ones((len(frames), 3))
    measured_in = _measured_in(frames, enough, scale)
    by_frame, by_point = _alike(seen.frame), _alike(seen.point)
    gains = np.zeros((len(frames), 3))
    for _ in range(ALTERNATIONS):
        of_points = _medians(seen.colours - gains[seen.frame], by_point, seen.points)
        last, gains = gains, _medians(seen.colours - of_points[seen.point], by_frame, len(frames))[measured_in]
        gains -= gains.mean(axis=0)
        if np.abs(gains - last).max() < SETTLED:
            break
    return np.exp(gains)


def _measured_in(frames: Sequence[Frame], enough: np.ndarray, scale: Scale) -> np.ndarray:
    """(F,) number of the photograph whose gain each has: its own, or the most similar one that sees enough."""
    cameras, measured = [frame.camera for frame in frames], np.flatnonzero(enough)
    apart = view_distances(cameras, [cameras[index] for index in measured], scale.distance)
    return np.where(enough, np.arange(len(frames)), measured[np.argmin(apart, axis=1)])


@dataclass(frozen=True)
class _Samples:
    """M colours, each of a point in a photograph; a table of all points in all photographs would be nearly empty.

    Attributes:
        frame: (M,) int64 number of the photograph.
        point: (M,) int64 number of the point.
        colours: (M, 3) float64 natural logarithms of red, green and blue.
    """

    frame: np.ndarray
    point: np.ndarray
    colours: np.ndarray

    @property
    def points(self) -> int:
        """Number of points."""
        return int(self.point.max(initial=-1)) + 1


def _samples(frames: Sequence[Frame], structure: Structure, scale: Scale) -> _Samples:
    """The colours of points that at least two photographs see well, numbered from 0."""
    cameras = [frame.camera for frame in frames]
    distances = view_distances(cameras, cameras, scale.distance)
    points, seen_by = _chosen_points(structure)
    # Drawn at random, since a point tells nothing if only one photograph draws it: photographs that all took the first
    # of the same many points would leave the others to the few that see little else.
    rng = np.random.default_rng(0)
    numbers, colours = [], []
    for frame, order in zip(frames, np.argsort(distances, axis=1, kind="stable"), strict=True):
        visible = np.unique(np.concatenate([seen_by[view] for view in order[:NEIGHBOURS]]))
        drawn = rng.permutation(visible)[:MOST_POINTS]
        seen, levels = _colours_at(frame, points[drawn])
        numbers.append(drawn[seen])
        colours.append(np.log(levels))
    frame_of, point = np.repeat(np.arange(len(frames)), [len(some) for some in numbers]), np.concatenate(numbers)
    shared = np.bincount(point)[point] >= 2
    _, renumbered = np.unique(point[shared], return_inverse=True)
    return _Samples(frame_of[shared], renumbered, np.concatenate(colours)[shared])


def _alike(group: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Groups of the same size together, whose samples fill a table.

    Args:
        group: (M,) number of the group that each sample belongs to.

    Returns:
        For each size S that groups have, unless it is 0, (G,) their numbers and (G, S) the numbers of their samples.
    """
    order = np.argsort(group, kind="stable")
    sizes = np.bincount(group)
    starts = np.cumsum(sizes) - sizes
    numbers = [np.flatnonzero(sizes == size) for size in np.unique(sizes[sizes > 0])]
    return [(some, order[starts[some, None] + np.arange(sizes[some[0]])]) for some in numbers]


def _medians(values: np.ndarray, alike: Sequence[tuple[np.ndarray, np.ndarray]], count: int) -> np.ndarray:
    """(N, 3) medians of (M, 3) values over each of N groups, given as `_alike` returns them; 0 for those without."""
    medians = np.zeros((count, 3))
    for groups, samples in alike:
        medians[groups] = np.median(values[samples], axis=1)
    return medians


def _chosen_points(structure: Structure) -> tuple[np.ndarray, list[np.ndarray]]:
    """(N, 3) points that are enough to tell exposures, and for each view the numbers of those that it sees."""
    seen = structure.observations
    chosen = np.zeros(len(structure.points), bool)
    chosen[seen.point[enough_for_each_view(seen, len(structure.cameras), ENOUGH_POINTS)]] = True
    place = np.cumsum(chosen) - 1
    return structure.points[chosen], [place[own.point[chosen[own.point]]] for own in structure.by_frame()]


def needs_compensation(frames: Sequence[Frame], gains: np.ndarray, scale: Scale) -> bool:
    """Whether photographs with similar views differ in exposure or white balance so much that one scene cannot look
    like all of them.

    Args:
        frames: F photographs with poses.
        gains: (F, 3) of each.
        scale: of the scene.
    """
    cameras = [frame.camera for frame in frames]
    apart = view_distances(cameras, cameras, scale.distance)
    np.fill_diagonal(apart, np.inf)
    similar = np.argsort(apart, axis=1, kind="stable")[:, : min(NEIGHBOURS, len(frames) - 1)]
    exposures = np.log(gains)
    variation = float(np.abs(exposures).mean())
    if variation < MIN_VARIATION:
        return False
    surprise = float(np.abs(exposures - exposures[similar].mean(axis=1)).mean())
    return surprise > PREDICTABLE * variation


def compensated(frames: Sequence[Frame], gains: np.ndarray) -> list[Frame]:
    """The photographs as they would have been taken at the mean exposure.

    White that a sensor cuts off, or that an object was laid on, stays white: nobody knows how bright it was.

    Args:
        frames: F photographs.
        gains: (F, 3) of each; those with alpha stay as they are, see `undone_gains`.
    """
    return [
        frame if frame.alpha is not None else replace(frame, image=_without_gain(frame.image, gain))
        for frame, gain in zip(frames, gains, strict=True)
    ]


def _without_gain(image: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8 of an image at the mean exposure; from BRIGHTEST to white it changes less and less."""
    found = image / gain
    rows, columns = np.nonzero(image.min(axis=2) > BRIGHTEST)
    bright = image[rows, columns]
    kept = (bright.min(axis=1, keepdims=True) - BRIGHTEST) / (255 - BRIGHTEST)
    found[rows, columns] += kept * (bright - found[rows, columns])
    return np.clip(np.rint(found), 0, 255).astype(np.uint8)


def undone_gains(frames: Sequence[Frame], gains: np.ndarray) -> np.ndarray | None:
    """The gains that `compensated` undoes: 1 for photographs with alpha, or None if all of them have it.

    They were cut out and laid on a background, which has no exposure.

    Args:
        frames: F photographs.
        gains: (F, 3) of each.
    """
    is_cut_out = np.array([frame.alpha is not None for frame in frames])
    return None if is_cut_out.all() else np.where(is_cut_out[:, None], 1.0, gains)


def _colours_at(frame: Frame, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) bool which points a photograph sees well, and (S, 3) float64 colours where those S fall in it."""
    pixels, depth = frame.camera.project(points)
    seen = frame.camera.shows(pixels, depth)
    columns, rows = np.where(seen[:, None], pixels, 0).astype(np.int64).T
    colours = cv2.GaussianBlur(frame.image, (0, 0), SMOOTHING)[rows, columns].astype(np.float64)
    seen &= np.all((colours >= DARKEST) & (colours <= BRIGHTEST), axis=1)
    if frame.alpha is not None:
        seen &= frame.alpha[rows, columns] == 255
    if frame.mask is not None:
        # Blurred colours near the mask's edge are mixed with what it leaves out.
        inner = cv2.erode(frame.mask.astype(np.uint8), np.ones((2 * BLUR_RADIUS + 1,) * 2, np.uint8))
        seen &= inner[rows, columns] > 0
    return seen, colours[seen]
