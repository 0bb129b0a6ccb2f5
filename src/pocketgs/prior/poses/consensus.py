"""Consensus per track: the observations that agree on a point under given poses, and the error of each against the
rest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import prange

from pocketgs.geometry.camera import Camera
from pocketgs.prior.features.observations import Observations
from pocketgs.system.compile import parallel_kernel, part

MAX_TRIALS = 36
"""Pairs of observations to triangulate per track; tracks of up to nine observations try all pairs."""


class Consensus(NamedTuple):
    """Agreement of M observations in N tracks, sorted by track.

    Attributes:
        agrees: (M,) bool: is in the largest set of observations within the tolerance of one point.
        support: (M,) int64 number of observations of the track that agree on a point triangulated without this one.
        others: (M, 3) float64 that point; NaN if there is none.
        error: (M,) float64 distance in pixels of the observation from that point's projection; infinite behind the
            camera.
    """

    agrees: np.ndarray
    support: np.ndarray
    others: np.ndarray
    error: np.ndarray


def consensus(cameras: Sequence[Camera], tracks: Observations, tolerance: float, least_angle: float) -> Consensus:
    """Find the consensus of each track.

    As in RANSAC, points are triangulated from pairs of observations, and the one that most others agree with wins.

    Args:
        cameras: of the views.
        tracks: observations sorted by point.
        tolerance: distance in pixels within which an observation agrees with a point.
        least_angle: between the two rays that make a point, in radians.
    """
    count = int(tracks.point[-1]) + 1 if len(tracks) else 0
    poses = np.array([camera.world_to_camera[:3] for camera in cameras])
    intrinsics = np.array([[camera.fx, camera.fy, camera.cx, camera.cy] for camera in cameras], np.float64)
    starts = np.searchsorted(tracks.point, np.arange(count + 1)).astype(np.int64)
    frame, pixels = tracks.frame.astype(np.int64), np.ascontiguousarray(tracks.pixels, np.float64)
    size = len(tracks)
    found = Consensus(np.zeros(size, bool), np.zeros(size, np.int64), np.full((size, 3), np.nan), np.full(size, np.inf))
    _vote(poses, intrinsics, starts, frame, pixels, tolerance, math.cos(least_angle), found)
    return found


@parallel_kernel
def _vote(
    poses: np.ndarray,
    intrinsics: np.ndarray,
    starts: np.ndarray,
    frame: np.ndarray,
    pixels: np.ndarray,
    tolerance: float,
    largest_cosine: float,
    found: Consensus,
) -> None:
    for track in prange(len(starts) - 1):
        _vote_on(poses, intrinsics, starts[track], starts[track + 1], frame, pixels, tolerance, largest_cosine, found)


@part
def _vote_on(
    poses: np.ndarray,
    intrinsics: np.ndarray,
    first: int,
    end: int,
    frame: np.ndarray,
    pixels: np.ndarray,
    tolerance: float,
    largest_cosine: float,
    found: Consensus,
) -> None:
    """Find the consensus of one track, with observations from `first` to before `end`."""
    count = end - first
    views, seen = frame[first : first + count], pixels[first : first + count]
    most, least_cost = 1, np.inf
    costs = np.full(count, np.inf)
    errors, point = np.empty(count), np.empty(3)
    pairs = count * (count - 1) // 2
    for trial in range(min(pairs, MAX_TRIALS)):
        one, other = _pair(trial * pairs // min(pairs, MAX_TRIALS), count)
        if not _meet(poses, intrinsics, views, seen, one, other, largest_cosine, point):
            continue
        near, cost = 0, 0.0
        for k in range(count):
            errors[k] = _error(poses[views[k]], intrinsics[views[k]], point, seen[k])
            if errors[k] < tolerance:
                near += 1
                cost += errors[k] ** 2
        if errors[one] >= tolerance or errors[other] >= tolerance:
            continue
        if near > most or (near == most and cost < least_cost):
            most, least_cost = near, cost
            for k in range(count):
                found.agrees[first + k] = errors[k] < tolerance
        for k in range(count):
            if k in (one, other):
                continue
            without, rest = (near - 1, cost - errors[k] ** 2) if errors[k] < tolerance else (near, cost)
            at = first + k
            if without > found.support[at] or (without == found.support[at] and rest < costs[k]):
                found.support[at], costs[k], found.error[at] = without, rest, errors[k]
                for axis in range(3):
                    found.others[at, axis] = point[axis]


@part
def _pair(number: int, count: int) -> tuple[int, int]:
    """The pair of `count` items with this number; pairs of neighbours come first."""
    step = 1
    while number >= count - step:
        number -= count - step
        step += 1
    return number, number + step


@part
def _meet(
    poses: np.ndarray,
    intrinsics: np.ndarray,
    views: np.ndarray,
    seen: np.ndarray,
    one: int,
    other: int,
    largest_cosine: float,
    point: np.ndarray,
) -> bool:
    """Write the midpoint of two rays at their closest approach; False if they are parallel or diverge."""
    p, q, u, v = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    _ray(poses[views[one]], intrinsics[views[one]], seen[one], p, u)
    _ray(poses[views[other]], intrinsics[views[other]], seen[other], q, v)
    cosine, along_u, along_v = 0.0, 0.0, 0.0
    for axis in range(3):
        cosine += u[axis] * v[axis]
        along_u += u[axis] * (q[axis] - p[axis])
        along_v += v[axis] * (q[axis] - p[axis])
    if cosine > largest_cosine:
        return False
    square = 1.0 - cosine * cosine
    s, t = (along_u - cosine * along_v) / square, (cosine * along_u - along_v) / square
    if not (s > 0.0 and t > 0.0):
        return False
    for axis in range(3):
        point[axis] = 0.5 * (p[axis] + s * u[axis] + q[axis] + t * v[axis])
    return True


@part
def _ray(
    pose: np.ndarray, intrinsics: np.ndarray, pixel: np.ndarray, centre: np.ndarray, direction: np.ndarray
) -> None:
    """Write a camera's centre and the unit direction through a pixel, in the world."""
    x, y = (pixel[0] - intrinsics[2]) / intrinsics[0], (pixel[1] - intrinsics[3]) / intrinsics[1]
    length = math.sqrt(x * x + y * y + 1.0)
    for axis in range(3):
        direction[axis] = (pose[0, axis] * x + pose[1, axis] * y + pose[2, axis]) / length
        centre[axis] = -(pose[0, axis] * pose[0, 3] + pose[1, axis] * pose[1, 3] + pose[2, axis] * pose[2, 3])


@part
def _error(pose: np.ndarray, intrinsics: np.ndarray, point: np.ndarray, pixel: np.ndarray) -> float:
    """Distance in pixels between a point's projection and a pixel; infinite for a point behind the camera."""
    x = pose[0, 0] * point[0] + pose[0, 1] * point[1] + pose[0, 2] * point[2] + pose[0, 3]
    y = pose[1, 0] * point[0] + pose[1, 1] * point[1] + pose[1, 2] * point[2] + pose[1, 3]
    z = pose[2, 0] * point[0] + pose[2, 1] * point[1] + pose[2, 2] * point[2] + pose[2, 3]
    if z <= 0.0:
        return np.inf
    right = intrinsics[0] * x / z + intrinsics[2] - pixel[0]
    down = intrinsics[1] * y / z + intrinsics[3] - pixel[1]
    return math.sqrt(right * right + down * down)
