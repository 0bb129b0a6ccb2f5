"""The scale of the scene, estimated from the cameras alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pocketgs.capture.capture import Capture
from pocketgs.geometry.camera_geometry import GUESSED_DISTANCE, focus_point, looks_at

ONE_PLACE, ROUNDING = 1e-3, 1e-9
"""Metres, and share of the distance to the origin, within which cameras count as being in one place.

Their axes then meet in that place, which says nothing about the scene.
"""

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

    If they face outwards or are in one place: 2 m, or if the capture is not metric a multiple of the cameras' spread; 1
    if that is zero.
    """
    cameras = [frame.camera for frame in capture.train]
    focus = focus_point(cameras)
    centres = np.array([camera.centre for camera in cameras])
    spread = float(np.sqrt(centres.var(axis=0).sum()))
    within = ONE_PLACE if capture.metric else max(ROUNDING * float(np.abs(centres).max()), ROUNDING**2)
    in_one_place = len(cameras) > 1 and spread <= within
    if in_one_place and not capture.metric:
        distance = 1.0
    elif looks_at(cameras, focus) and not in_one_place:
        distance = float(np.median(np.linalg.norm(centres - focus, axis=1)))
    elif capture.metric:
        distance = METRIC_DISTANCE
    else:
        distance = GUESSED_DISTANCE * spread
    distance = max(distance, np.finfo(np.float32).tiny)
    return Scale(distance, 1.0 if capture.metric else distance)
