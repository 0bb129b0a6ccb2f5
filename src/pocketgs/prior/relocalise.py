"""Poses of the frames that are no keyframes: adjusted, one by one, to the points that the keyframes know."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pocketgs.camera import Camera
from pocketgs.capture.capture import Frame
from pocketgs.prior.bundle import adjust_pose
from pocketgs.prior.features import Features, match
from pocketgs.prior.observations import Observations
from pocketgs.prior.scale import Scale
from pocketgs.prior.structure import Structure, StructureSettings, detect_all
from pocketgs.prior.tracks import reprojection_errors, view_distances

NEIGHBOURS = 4
"""Keyframes that a frame is matched with, those with the most similar views."""

FEWEST_SIGHTINGS = 12


@dataclass(frozen=True)
class Relocalisation:
    """Where frames were found to be.

    Attributes:
        cameras: of the frames, in their order.
        carried: names of frames that see too few points, and follow the keyframe nearest to them.
    """

    cameras: list[Camera]
    carried: tuple[str, ...]


def relocalise(
    frames: Sequence[Frame],
    keyframes: Sequence[Frame],
    structure: Structure,
    scale: Scale,
    settings: StructureSettings,
) -> Relocalisation:
    """Place frames in the world that bundle adjustment has refined, by motion-only adjustment.

    Args:
        frames: with given poses.
        keyframes: K frames with given poses.
        structure: what bundle adjustment made of the keyframes.
        scale: of the scene.
        settings: as for the keyframes.
    """
    given = [frame.camera for frame in keyframes]
    distances = view_distances([frame.camera for frame in frames], given, scale.distance)
    cameras, carried = [], []
    features = detect_all(frames, settings.features)
    for frame, own, order in zip(frames, features, np.argsort(distances, axis=1, kind="stable"), strict=True):
        start = _carried(frame.camera, given[order[0]], structure.cameras[order[0]])
        pixels, points = _sightings(own, structure, order[:NEIGHBOURS])
        placed = _placed(start, pixels, points, scale, settings)
        if placed is None:
            carried.append(frame.name)
        cameras.append(placed or start)
    return Relocalisation(cameras, tuple(carried))


def _carried(camera: Camera, keyframe: Camera, refined: Camera) -> Camera:
    """The camera, with the pose relative to a keyframe that it was given."""
    relative = camera.world_to_camera @ keyframe.camera_to_world
    return replace(camera, world_to_camera=relative @ refined.world_to_camera)


def _sightings(own: Features, structure: Structure, views: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(M, 2) pixels of a frame's features, and (M, 3) the points that keyframes' features like them belong to."""
    pairs = [np.zeros((0, 2), np.int64)]
    for view in views:
        theirs, point = structure.landmarks[view]
        found = match(own, theirs)
        pairs.append(np.stack([found[:, 0], point[found[:, 1]]], axis=1))
    feature, point = np.unique(np.concatenate(pairs), axis=0).T
    return own.pixels[feature], structure.points[point]


def _placed(
    start: Camera, pixels: np.ndarray, points: np.ndarray, scale: Scale, settings: StructureSettings
) -> Camera | None:
    """The camera adjusted to its sightings, leaving out what lies far off round by round; None if too few are left."""
    each = np.arange(len(points))
    camera = start
    for threshold in settings.rounds:
        near = reprojection_errors([camera], points, Observations(np.zeros_like(each), each, pixels)) < threshold
        if np.count_nonzero(near) < FEWEST_SIGHTINGS:
            return None
        camera = adjust_pose(start, points[near], pixels[near], settings.bundle_settings(scale)).camera
    return camera
