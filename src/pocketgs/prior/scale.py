"""The scale of the scene, estimated from the cameras, or from the capture's own points where those say nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pocketgs.capture.capture import Capture
from pocketgs.geometry.camera import Camera
from pocketgs.geometry.camera_geometry import GUESSED_DISTANCE, MIN_CONVERGENCE, focus_point, looks_at, spread_of
from pocketgs.prior.seen_points import seen_points

ONE_PLACE = 1e-3
"""Metres within which cameras count as being in one place: where their axes meet then says nothing about the scene."""

METRIC_DISTANCE = 2.0
"""Assumed distance in metres from a phone to its subject, if poses do not determine it."""


@dataclass(frozen=True)
class Scale:
    """Typical lengths of a capture.

    Attributes:
        distance: typical distance from the cameras to the scene.
        unit: factor for thresholds given in metres: 1 in metric captures, otherwise `distance`.
    """

    distance: float
    unit: float


def estimate_scale(capture: Capture) -> Scale:
    """The median distance from the training cameras to the point nearest to their optical axes.

    If the axes do not determine that point, as those of cameras that face outwards, are in one place or look the same
    way: the median depth of the capture's own points that the cameras see. In metric captures, or without such points,
    it is a guess: see `_guess`.
    """
    cameras = [frame.camera for frame in capture.train]
    distance = None if capture.metric or _axes_meet(cameras) else _median_depth(capture)
    if distance is None:
        distance = _guess(cameras, capture.metric)
    distance = max(distance, np.finfo(np.float32).tiny)
    return Scale(distance, 1.0 if capture.metric else distance)


def _axes_meet(cameras: Sequence[Camera]) -> bool:
    """Whether the optical axes determine a point that the cameras look at; lengths are not metres."""
    focus = focus_point(cameras)
    forwards = np.array([camera.forward for camera in cameras])
    smallest, _, largest = np.linalg.eigvalsh(np.eye(3) - forwards.T @ forwards / len(forwards))
    return bool(smallest > MIN_CONVERGENCE * largest) and looks_at(cameras, focus)


def _median_depth(capture: Capture) -> float | None:
    """Of the capture's own points that the training cameras see; None if they see none."""
    if capture.points is None:
        return None
    seen = seen_points(capture.points, capture.train)
    depths = np.concatenate([frame.camera.depths(some) for frame, some in zip(capture.train, seen, strict=True)])
    return float(np.median(depths)) if len(depths) else None


def _guess(cameras: Sequence[Camera], metric: bool) -> float:
    """The distance from the cameras alone.

    If they face outwards or are in one place: 2 m, or if lengths are not metres a multiple of the cameras' spread; 1 if
    that is zero.
    """
    focus = focus_point(cameras)
    centres = np.array([camera.centre for camera in cameras])
    spread = spread_of(centres)
    in_one_place = len(cameras) > 1 and spread <= (ONE_PLACE if metric else 0.0)
    if in_one_place and not metric:
        return 1.0
    if looks_at(cameras, focus) and not in_one_place:
        return float(np.median(np.linalg.norm(centres - focus, axis=1)))
    return METRIC_DISTANCE if metric else GUESSED_DISTANCE * spread
