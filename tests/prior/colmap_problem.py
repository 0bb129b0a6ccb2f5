"""Bundle adjustment problems in COLMAP's hands: its top left pixel is centred at (0.5, 0.5), too."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pytest

from pocketgs.geometry.camera import Camera
from pocketgs.prior.features.observations import Observations

if TYPE_CHECKING:
    import pycolmap
else:
    pycolmap = pytest.importorskip("pycolmap")


def to_reconstruction(
    cameras: Sequence[Camera], points: np.ndarray, observations: Observations
) -> pycolmap.Reconstruction:
    """A reconstruction whose image i + 1 is camera i, with its own intrinsics, and whose 3D point p + 1 is point p."""
    reconstruction = pycolmap.Reconstruction()
    index_in_image = np.empty(len(observations.frame), int)
    for i, camera in enumerate(cameras):
        own = np.flatnonzero(observations.frame == i)
        index_in_image[own] = np.arange(len(own))
        reconstruction.add_camera_with_trivial_rig(
            pycolmap.Camera(
                camera_id=i + 1,
                model="PINHOLE",
                width=camera.width,
                height=camera.height,
                params=[camera.fx, camera.fy, camera.cx, camera.cy],
            )
        )
        image = pycolmap.Image(name=f"{i}", keypoints=observations.pixels[own], camera_id=i + 1, image_id=i + 1)
        reconstruction.add_image_with_trivial_frame(image, pycolmap.Rigid3d(camera.world_to_camera[:3]))
    for p, position in enumerate(points):
        track = pycolmap.Track()
        for k in np.flatnonzero(observations.point == p):
            track.add_element(observations.frame[k] + 1, index_in_image[k])
        reconstruction.add_point3D(position, track)
    return reconstruction


def adjust_with_colmap(
    cameras: Sequence[Camera], points: np.ndarray, observations: Observations, huber: float
) -> tuple[list[np.ndarray], np.ndarray]:
    """COLMAP's bundle adjustment with fixed intrinsics.

    Returns:
        (4, 4) world_to_camera of every camera, and (N, 3) points.
    """
    reconstruction = to_reconstruction(cameras, points, observations)
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_focal_length = options.refine_extra_params = False
    options.print_summary = False
    options.ceres.loss_function_type = pycolmap.LossFunctionType.HUBER
    options.ceres.loss_function_scale = huber
    options.ceres.solver_options.gradient_tolerance = 1e-10
    pycolmap.bundle_adjustment(reconstruction, options)
    poses = []
    for i in range(len(cameras)):
        pose = np.eye(4)
        pose[:3] = reconstruction.image(i + 1).cam_from_world().matrix()
        poses.append(pose)
    return poses, np.array([reconstruction.point3D(p + 1).xyz for p in range(len(points))])
