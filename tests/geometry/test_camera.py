"""The pinhole camera: projection, and rays as its inverse."""

from __future__ import annotations

import numpy as np
import pytest

from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera, look_at


def test_a_point_on_a_ray_falls_on_the_rays_pixel_at_its_depth() -> None:
    pose = look_at(np.array([1.0, -2.0, 0.5]), np.zeros(3), np.array([0.1, 0.0, 1.0]))
    camera = Camera(640, 480, 500.0, 510.0, 310.0, 250.0, pose)
    rng = np.random.default_rng(0)
    pixels, depths = rng.uniform(0, 480, (50, 2)), rng.uniform(0.1, 9, 50)
    found, depth = camera.project(camera.centre + camera.rays(pixels) * depths[:, None])
    np.testing.assert_allclose(found, pixels, rtol=1e-9)
    np.testing.assert_allclose(depth, depths, rtol=1e-9)


def test_an_image_contains_its_left_and_top_edges_only() -> None:
    camera = Camera(640, 480, 500.0, 510.0, 310.0, 250.0, np.eye(4))
    inside = [(0.0, 0.0), (0.5, 0.5), (639.9, 479.9), (310.0, 0.0), (0.0, 250.0)]
    outside = [(-0.1, 250.0), (310.0, -0.1), (640.0, 250.0), (310.0, 480.0), (900.0, -1.0), (np.nan, 250.0)]
    found = camera.contains(np.array(inside + outside))
    assert found.tolist() == [True] * len(inside) + [False] * len(outside)
    assert camera.contains(np.zeros((0, 2))).shape == (0,)


def test_poses_that_are_not_rigid() -> None:
    pose = look_at(np.array([1.0, -2.0, 0.5]), np.zeros(3), np.array([0.1, 0.0, 1.0]))
    mirrored, stretched, projective = np.diag([1.0, 1.0, -1.0, 1.0]) @ pose, 1.01 * pose, pose.copy()
    projective[3, 3] = 2.0
    for wrong, message in (
        (pose.T, r"last row is \(.*\), expected \(0, 0, 0, 1\): is it transposed"),
        (projective, "last row is"),
        (mirrored, "is not a rotation"),
        (stretched, "is not a rotation"),
    ):
        with pytest.raises(PocketGSError, match=message):
            Camera(640, 480, 500.0, 510.0, 310.0, 250.0, wrong)
    Camera(640, 480, 500.0, 510.0, 310.0, 250.0, pose + 1e-5)


def test_views_that_have_no_pose() -> None:
    eye, up = np.array([0.0, 0.0, 5.0]), np.array([0.0, 0.0, 1.0])
    for tilt in (up, -up, np.array([0.1, 0.7, -0.3])):
        with pytest.raises(PocketGSError, match="up is parallel to the view"):
            look_at(3.3 * tilt, np.zeros(3), tilt)
    with pytest.raises(PocketGSError, match="the eye is where the target is"):
        look_at(eye, eye, np.array([0.0, 1.0, 0.0]))
