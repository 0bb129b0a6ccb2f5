"""Pose refinement: bundle adjustment over all frames, accepted only if validation shows that poses get better."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.prior.features.observations import Observations
from pocketgs.prior.features.tracks import view_distances
from pocketgs.prior.poses.robust_adjustment import RobustAdjustment
from pocketgs.prior.poses.validation import validated


@dataclass(frozen=True)
class Refinement:
    """The result of refinement for F cameras.

    Attributes:
        cameras: refined where accepted, otherwise as given.
        moved: (F,) bool: refined.
        carried: (F,) bool: sees too few points, and was moved with the nearest refined camera.
    """

    cameras: list[Camera]
    moved: np.ndarray
    carried: np.ndarray


def refine(
    adjustment: RobustAdjustment, tracks: Observations, images: Sequence[np.ndarray], scene_distance: float
) -> Refinement:
    """Adjust poses, component by component, and keep those that pass validation.

    Args:
        adjustment: of F cameras.
        tracks: observations sorted by point, including wrong ones.
        images: F (H, W, 3) uint8, of the cameras' sizes.
        scene_distance: typical distance to the scene.
    """
    given = adjustment.given
    nothing = Refinement(list(given), np.zeros(len(given), bool), np.zeros(len(given), bool))
    accepted = validated(adjustment, tracks, images)
    if not accepted.any():
        return nothing
    adjusted = adjustment.adjusted(tracks)
    moved = accepted & adjusted.supported
    if not moved.any():
        return nothing
    cameras = [new if move else old for old, new, move in zip(given, adjusted.cameras, moved, strict=True)]
    carried = _poorly_supported(given, moved, adjusted.supported, scene_distance)
    for view in np.flatnonzero(carried).tolist():
        nearest = _nearest(given[view], given, moved, scene_distance)
        cameras[view] = carried_along(given[view], given[nearest], adjusted.cameras[nearest])
    return Refinement(cameras, moved, carried)


def carried_along(camera: Camera, given: Camera, refined: Camera) -> Camera:
    """The camera, keeping its given pose relative to another camera that has been refined."""
    relative = camera.world_to_camera @ given.camera_to_world
    return replace(camera, world_to_camera=relative @ refined.world_to_camera)


def _poorly_supported(
    given: Sequence[Camera], moved: np.ndarray, supported: np.ndarray, scene_distance: float
) -> np.ndarray:
    """(F,) bool: cameras that see too few points, and whose nearest well-supported neighbour has moved."""
    found = np.zeros(len(given), bool)
    for view in np.flatnonzero(~supported).tolist():
        found[view] = moved[_nearest(given[view], given, supported, scene_distance)]
    return found


def _nearest(camera: Camera, others: Sequence[Camera], among: np.ndarray, scene_distance: float) -> int:
    numbers = np.flatnonzero(among).tolist()
    distances = view_distances([camera], [others[number] for number in numbers], scene_distance)[0]
    return int(numbers[int(distances.argmin())])
