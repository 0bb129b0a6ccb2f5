"""Cameras with lenses: OpenCV's projection, rays as its inverse, and angles at which polynomials fold back."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera, look_at
from pocketgs.geometry.lens import Lens, largest_angle

LENSES = {
    "opencv": Lens("opencv", (-0.2, 0.05, 0.003, -0.004)),
    "prism": Lens("opencv", (-0.2, 0.05, 0.003, -0.004, 0.02, 0.03, 0.01, 0.002, 0.004, -0.003, 0.002, 0.001)),
    "fisheye": Lens("fisheye", (0.05, -0.02, 0.004, -0.001)),
    "orthographic": Lens("orthographic"),
}


def seen_through(name: str) -> Camera:
    pose = look_at(np.array([1.0, -2.0, 0.5]), np.zeros(3), np.array([0.1, 0.0, 1.0]))
    return Camera(640, 480, 500.0, 510.0, 310.0, 250.0, pose, LENSES[name])


@pytest.mark.parametrize("name", ["opencv", "prism", "fisheye"])
def test_projects_as_opencv(name: str) -> None:
    camera = seen_through(name)
    local = np.random.default_rng(0).uniform((-0.8, -0.6, 1.0), (0.8, 0.6, 2.0), (100, 3))
    world = (local - camera.world_to_camera[:3, 3]) @ camera.world_to_camera[:3, :3]
    matrix, coefficients = camera.intrinsic_matrix, np.array(camera.lens.coefficients)
    project = cv2.fisheye.projectPoints if name == "fisheye" else cv2.projectPoints
    points = local[:, None] if name == "fisheye" else local
    expected = project(points, np.zeros(3), np.zeros(3), matrix, coefficients)[0].reshape(-1, 2)
    pixels, depth = camera.project(world)
    np.testing.assert_allclose(pixels, expected, atol=1e-6)
    np.testing.assert_allclose(depth, np.linalg.norm(local, axis=1) if name == "fisheye" else local[:, 2])
    np.testing.assert_allclose(depth, camera.depths(world))


@pytest.mark.parametrize("name", ["opencv", "prism", "fisheye"])
def test_a_point_on_a_ray_falls_on_the_rays_pixel_at_its_depth(name: str) -> None:
    camera = seen_through(name)
    rng = np.random.default_rng(0)
    pixels, depths = rng.uniform((0, 0), (640, 480), (50, 2)), rng.uniform(0.1, 9, 50)
    found, depth = camera.project(camera.centre + camera.rays(pixels) * depths[:, None])
    np.testing.assert_allclose(found, pixels, atol=1e-5)
    np.testing.assert_allclose(depth, depths, rtol=1e-9)


def test_a_wide_fisheye_sees_beside_and_behind_itself() -> None:
    camera = Camera(700, 700, 120.0, 120.0, 350.0, 350.0, np.eye(4), LENSES["fisheye"])
    pixels = np.array([[350.0 + 190.0, 350.0], [350.0, 350.0 - 205.0]])
    rays = camera.rays(pixels)
    assert rays[1, 2] < 0
    found, depth = camera.project(rays * 3.0)
    np.testing.assert_allclose(found, pixels, atol=1e-6)
    np.testing.assert_allclose(depth, 3.0)


def test_what_lies_beyond_the_fold_has_no_depth() -> None:
    # r (1 - 0.2 r²) turns back at r = 1.291, θ (1 - 0.1 θ²) at θ = 1.826.
    for lens, limit in ((Lens("opencv", (-0.2, 0.0, 0.0, 0.0)), 1.2910), (Lens("fisheye", (-0.1, 0, 0, 0)), None)):
        angle = math.atan(limit) if limit else 1.8257
        assert largest_angle(lens) == pytest.approx(angle, abs=3e-3)
        camera = Camera(100, 100, 50.0, 50.0, 50.0, 50.0, np.eye(4), lens)
        angles = np.array([angle - 0.01, angle + 0.01, math.pi - 0.01])
        points = np.column_stack([np.sin(angles), np.zeros(3), np.cos(angles)])
        assert (camera.project(points)[1] > 0).tolist() == [True, False, False]
    assert largest_angle(Lens("opencv", (0.1, 0.02, 0.0, 0.0))) == math.pi / 2


@pytest.mark.parametrize(
    "lens",
    [
        Lens("opencv", (-1e9, 0.0, 0.0, 0.0)),
        Lens("opencv", (0.0, 0.0, 1e6, 0.0)),
        Lens("fisheye", (-1e9, 0.0, 0.0, 0.0)),
    ],
)
def test_a_lens_that_folds_at_its_middle_has_no_image(lens: Lens) -> None:
    camera = Camera(100, 100, 50.0, 50.0, 50.0, 50.0, np.eye(4), lens)
    points, pixels = np.ones((1, 3)), np.ones((1, 2))
    for use in (lambda: largest_angle(lens), lambda: camera.project(points), lambda: camera.rays(pixels)):
        with pytest.raises(PocketGSError, match="fold the image back at its middle"):
            use()


@pytest.mark.parametrize("name", LENSES)
def test_resizing_and_cropping_keep_the_lens(name: str) -> None:
    camera = seen_through(name)
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (20, 3))
    pixels, _ = camera.project(points)
    np.testing.assert_allclose(camera.resized(320, 240).project(points)[0], pixels / 2)
    np.testing.assert_allclose(camera.cropped(20, 10, 300, 300).project(points)[0], pixels - (20, 10))


def test_a_lens_is_a_lens() -> None:
    with pytest.raises(PocketGSError, match="lens is str, expected a Lens"):
        replace(seen_through("opencv"), lens="fisheye")  # type: ignore[arg-type]
