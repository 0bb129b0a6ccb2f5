"""The observations of a problem as lists for the GPU: by point, by camera, and by pair of cameras."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pocketgs.prior.bundle.reprojection import Sightings


@dataclass(frozen=True, eq=False)
class Meetings:
    """Observations of a point by two cameras, for every pair of cameras that see a point in common.

    Attributes:
        pairs: (P, 2) the cameras, the first not before the second; a camera makes a pair with itself too.
        starts: (P + 1,) uint32: the observations of pair i are rows starts[i] to starts[i + 1].
        observations: (E, 2) uint32, by the first and by the second camera.
    """

    pairs: np.ndarray
    starts: np.ndarray
    observations: np.ndarray


def meeting_count(sightings: Sightings) -> int:
    """At most so many rows `Meetings.observations` has."""
    return int(np.sum(np.diff(sightings.starts) ** 2))


def meetings_of(sightings: Sightings) -> Meetings:
    """The meetings of a problem, sorted by pair."""
    views = np.diff(sightings.starts)
    # Every observation meets all those of its point, which lie side by side.
    partners = views[sightings.point]
    first = np.repeat(np.arange(len(sightings.frame)), partners)
    within = np.arange(len(first)) - np.repeat(np.cumsum(partners) - partners, partners)
    second = sightings.starts[sightings.point[first]] + within
    kept = sightings.frame[first] >= sightings.frame[second]
    first, second = first[kept], second[kept]
    frames = len(sightings.intrinsics)
    key = sightings.frame[first] * frames + sightings.frame[second]
    order = np.argsort(key, kind="stable")
    pairs, starts = np.unique(key[order], return_index=True)
    return Meetings(
        np.column_stack([pairs // frames, pairs % frames]),
        np.append(starts, len(key)).astype(np.uint32),
        np.column_stack([first[order], second[order]]).astype(np.uint32),
    )


def by_camera(sightings: Sightings) -> tuple[np.ndarray, np.ndarray]:
    """(F + 1,) uint32 starts of the cameras' rows, and (M, 2) uint32 rows: an observation and its point."""
    order = np.argsort(sightings.frame, kind="stable")
    starts = np.searchsorted(sightings.frame[order], np.arange(len(sightings.intrinsics) + 1))
    return starts.astype(np.uint32), np.column_stack([order, sightings.point[order]]).astype(np.uint32)
