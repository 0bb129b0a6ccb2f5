"""The true camera path of the demo."""

from __future__ import annotations

import numpy as np

from pocketgs.geometry.camera import Camera, look_at

DURATION = 50.0
"""Seconds from the first frame to the last."""

FIELD_OF_VIEW = np.radians(62)
RADIUS = 1.5
MIDDLE_AZIMUTH, ARC = np.radians(-45), np.radians(150)
LOW, HIGH = 1.12, 1.5
LOOK_AT = np.array([0.0, 0.02, 0.62])


def true_camera(time: float, width: int, height: int) -> Camera:
    """The camera `time` seconds after the first frame: along the arc, up, and back at a greater height.

    Sines with incommensurate periods imitate steps and an unsteady hand.
    """
    along, level = _track(time / DURATION)
    azimuth = MIDDLE_AZIMUTH + along / RADIUS
    steps = 2 * np.pi * 0.9 * time
    distance = RADIUS + 0.06 * np.sin(0.37 * time + 1)
    eye = np.array([distance * np.cos(azimuth), distance * np.sin(azimuth), level])
    eye += np.array([0.008 * np.sin(0.5 * steps), 0.008 * np.sin(0.5 * steps + 1), 0.01 * np.sin(steps)])
    sway = 0.07 * np.sin([0.61 * time, 0.83 * time + 1, 0.47 * time + 2])
    tremor = 0.01 * np.sin([15.1 * time, 17.3 * time + 1, 13.7 * time + 2])
    up = np.array([0.05 * np.sin(0.53 * time), 0.05 * np.cos(0.71 * time), 1.0])
    focal = focal_length(width)
    return Camera(width, height, focal, focal, width / 2, height / 2, look_at(eye, LOOK_AT + sway + tremor, up))


def focal_length(width: int) -> float:
    """Focal length in pixels, for images of `width` pixels."""
    return float(0.5 * width / np.tan(FIELD_OF_VIEW / 2))


def _track(progress: float) -> tuple[float, float]:
    """Metres along the arc from its middle, and eye height, at constant speed with a bend at the far end."""
    reach, bend = 0.5 * ARC * RADIUS, 0.5 * (HIGH - LOW)
    walked = progress * (4 * reach + np.pi * bend)
    if walked < 2 * reach:
        return walked - reach, LOW
    turned = (walked - 2 * reach) / bend
    if turned < np.pi:
        return reach + bend * np.sin(turned), LOW + bend * (1 - np.cos(turned))
    return reach - (walked - 2 * reach - np.pi * bend), HIGH
