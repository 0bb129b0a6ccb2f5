"""Moving captures that are far from their origin, such as those in a national grid, to an origin of their own.

Scenes are float32, with 24 bits per coordinate: 100,000 units away the resolution is 0.008 units.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pocketgs.capture.listing import Listing
from pocketgs.geometry.camera import Camera
from pocketgs.scene.point_cloud import PointCloud

if TYPE_CHECKING:
    from pocketgs.capture.capture import Capture, Frame

FAR = 1000.0
"""Cameras are far if their distance exceeds this many times their extent: the resolution is then a tenth of a pixel."""

EXTENT_SHARE = 0.8
"""The extent is that of this share of the cameras: a few lost poses, often at zero, must not make it the distance."""

ONE_POINT = 1e-14
"""Cameras that extend less than this fraction of their distance are all at one point, which tells no scale."""

METRIC_EXTENT = 1.0
"""Minimum extent of metric captures: within a kilometre of the origin they are not moved."""

Origin = tuple[float, float, float]
"""Position of a capture's coordinate origin in its own world."""


def near_origin(listing: Listing) -> Listing:
    """Move a listing that is far from its origin to a new one in its middle, at round coordinates."""
    origin = middle_if_far(np.array([frame.camera.centre for frame in listing.frames]), listing.metric)
    if origin is None:
        return listing
    frames = [replace(frame, camera=moved_camera(frame.camera, np.array(origin))) for frame in listing.frames]
    added = ", ".join(f"{value:.12g}" for value in origin)
    warning = f"the capture lies far from its origin: add ({added}) to the scene's coordinates to get the capture's"
    return replace(
        listing,
        frames=frames,
        points=moved_points(listing.points, np.array(origin)),
        origin=origin,
        warnings=(*listing.warnings, warning),
    )


def middle_if_far(centres: np.ndarray, metric: bool) -> Origin | None:
    """The middle of the cameras, rounded to a power of ten of about their extent; None if the origin is near enough.

    It is, whatever the distance, if most cameras are at one point.

    Args:
        centres: (N, 3) of the cameras.
        metric: whether lengths are metres.
    """
    middle = np.median(centres, axis=0)
    spread = float(np.quantile(np.abs(centres - middle).max(axis=1), EXTENT_SHARE, method="lower"))
    extent = max(spread, METRIC_EXTENT if metric else 0.0)
    distance = float(np.abs(middle).max())
    if distance <= FAR * extent or extent <= ONE_POINT * distance:
        return None
    digits = -math.floor(math.log10(extent))
    x, y, z = (round(float(value), digits) for value in middle)
    return x, y, z


def moved_camera(camera: Camera, offset: np.ndarray) -> Camera:
    """The camera in coordinates with their origin at `offset`."""
    pose = camera.world_to_camera.copy()
    pose[:3, 3] += pose[:3, :3] @ offset
    return replace(camera, world_to_camera=pose)


def moved_points(points: PointCloud | None, offset: np.ndarray) -> PointCloud | None:
    """The cloud in coordinates with their origin at `offset`."""
    return points if points is None else replace(points, positions=points.positions - offset)


def with_origin(capture: Capture, origin: Origin) -> Capture:
    """The capture in coordinates with their origin at `origin` in its world."""
    if capture.origin == origin:
        return capture
    offset = np.subtract(origin, capture.origin)

    def moved(frames: list[Frame]) -> list[Frame]:
        return [replace(frame, camera=moved_camera(frame.camera, offset)) for frame in frames]

    return replace(
        capture,
        train=moved(capture.train),
        held_out=moved(capture.held_out),
        points=moved_points(capture.points, offset),
        origin=origin,
    )
