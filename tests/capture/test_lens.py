"""Undoing lens distortion."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from pocketgs.capture.listing import FrameSource
from pocketgs.capture.loading import Preparation, load_frame
from pocketgs.capture.undistortion import inner_rectangle, undistortion
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.geometry.lens import Lens, distort, undistort

LENSES = {
    "barrel": Lens("opencv", (-0.25, 0.05, 0.001, -0.002)),
    "pincushion": Lens("opencv", (0.15, 0.02, -0.001, 0.001, 0.01)),
    "rational": Lens("opencv", (0.5, 0.1, 0.001, 0.0, 0.02, 0.6, 0.15, 0.01)),
    "fisheye": Lens("fisheye", (0.04, -0.01, 0.003, -0.001)),
}


def camera_of(width: int = 320, height: int = 240, focal: float = 200.0) -> Camera:
    return Camera(width, height, focal, focal * 1.02, width / 2 + 3.3, height / 2 - 2.2, np.eye(4))


def opencv_distorted(lens: Lens, points: np.ndarray) -> np.ndarray:
    coefficients = np.array(lens.coefficients)
    if lens.model == "fisheye":
        return cv2.fisheye.distortPoints(points[None], np.eye(3), coefficients)[0]
    rays = np.concatenate([points, np.ones((len(points), 1))], axis=1)
    return cv2.projectPoints(rays, np.zeros(3), np.zeros(3), np.eye(3), coefficients)[0][:, 0]


@pytest.mark.parametrize("name", LENSES)
def test_distorts_as_opencv_and_back(name):
    points = np.random.default_rng(0).uniform(-0.8, 0.8, (200, 2))
    distorted = distort(LENSES[name], points)
    np.testing.assert_allclose(distorted, opencv_distorted(LENSES[name], points), atol=1e-9)
    np.testing.assert_allclose(undistort(LENSES[name], distorted), points, atol=1e-7)


def test_beyond_the_fold_points_stay_where_the_lens_ends():
    # The derivatives 1 + 3 k1 r² + 5 k2 r⁴ vanish there; the second lens has another branch further out.
    for lens, fold in ((Lens("opencv", (-0.2, 0.0, 0.0, 0.0)), 1.29099), (Lens("opencv", (-0.3, 0.03, 0, 0)), 1.21346)):
        found = undistort(lens, np.array([[2.0, 0.0], [0.0, -5.0], [0.3, 0.3]]))
        radii = np.linalg.norm(found, axis=1)
        assert np.all((radii[:2] > 0.97 * fold) & (radii[:2] <= fold))
        np.testing.assert_allclose(distort(lens, found)[2], 0.3)


def test_wide_fisheye_is_bounded():
    camera = Camera(1000, 1000, 250.0, 250.0, 500.0, 500.0, np.eye(4))
    left, top, right, bottom = inner_rectangle(camera, Lens("fisheye", (0.0, 0.0, 0.0, 0.0)))
    corner = np.hypot(right - left, bottom - top) / 2 / 250
    assert np.degrees(np.arctan(corner)) == pytest.approx(75, abs=0.5)


@pytest.mark.parametrize("name", LENSES)
def test_crop_is_tight_and_shows_only_what_the_lens_saw(name):
    camera = camera_of()
    undoing = undistortion(camera, LENSES[name])
    for positions, side in ((undoing.map_x, 320), (undoing.map_y, 240)):
        assert positions.min() >= -1e-3
        assert positions.max() <= side - 1 + 1e-3
    edges = [undoing.map_x[:, 0].min(), 319 - undoing.map_x[:, -1].max()]
    edges += [undoing.map_y[0].min(), 239 - undoing.map_y[-1].max()]
    assert max(edges) < 2.5


@pytest.mark.parametrize("interpolated_for", [1.0, 2.0])
@pytest.mark.parametrize("name", LENSES)
def test_points_land_where_the_pinhole_camera_sees_them(tmp_path, name, interpolated_for):
    camera, lens = camera_of(), LENSES[name]
    grid = np.stack(np.meshgrid(np.linspace(-0.4, 0.4, 5), np.linspace(-0.3, 0.3, 4)), axis=-1).reshape(-1, 2)
    shown = opencv_distorted(lens, grid) * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    Image.fromarray(blobs(shown, 320, 240)).save(tmp_path / "blobs.png")
    source = FrameSource("blobs.png", tmp_path / "blobs.png", camera, lens)
    frame = load_frame(source, Preparation(downscale=interpolated_for))
    pixels, _ = frame.camera.project(np.concatenate([grid, np.ones((len(grid), 1))], axis=1))
    errors = np.array([centroid(frame.image[:, :, 0], pixel) - pixel for pixel in pixels])
    # A disc that is stretched unevenly, or interpolated, shifts a little; a shift of all would be a wrong convention.
    assert np.linalg.norm(errors, axis=1).max() < 0.08
    assert np.linalg.norm(errors.mean(axis=0)) < 0.01


def blobs(centres: np.ndarray, width: int, height: int) -> np.ndarray:
    """(H, W, 3) uint8 with a small bright disc at each place, pixel centres at + 0.5."""
    y, x = np.mgrid[:height, :width] + 0.5
    image = sum(np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / (2 * 2.0**2)) for cx, cy in centres)
    return np.repeat(np.rint(image * 250).astype(np.uint8)[:, :, None], 3, axis=2)


def centroid(image: np.ndarray, near: np.ndarray, reach: int = 8) -> np.ndarray:
    left, top = (np.floor(near) - reach).astype(int)
    window = image[top : top + 2 * reach + 1, left : left + 2 * reach + 1].astype(float)
    y, x = np.mgrid[: window.shape[0], : window.shape[1]] + 0.5
    return np.array([(x * window).sum(), (y * window).sum()]) / window.sum() + [left, top]


def test_no_distortion_keeps_the_image_whole():
    assert inner_rectangle(camera_of(), Lens("opencv", (0.0, 0.0, 0.0, 0.0))) == (0, 0, 320, 240)


@pytest.mark.parametrize(
    ("model", "coefficients"),
    [("fov", (1.0,)), ("opencv", (1.0,)), ("fisheye", ()), ("fisheye", (0.0, 0.0, 0.0, float("nan")))],
)
def test_wrong_lenses(model, coefficients):
    with pytest.raises(PocketGSError, match="lens"):
        Lens(model, coefficients)


def test_images_too_large_to_remap():
    lens = Lens("opencv", (-0.01, 0.0, 0.0, 0.0))
    with pytest.raises(PocketGSError, match="at most"):
        undistortion(Camera(40_000, 10_000, 40_000.0, 40_000.0, 20_000.0, 5000.0, np.eye(4)), lens)


coefficient = st.floats(-2, 2) | st.floats(-1e6, 1e6)


@settings(max_examples=60)
@given(
    model=st.sampled_from(["opencv", "fisheye"]),
    coefficients=st.tuples(*[coefficient] * 4),
    focal=st.floats(1e-2, 1e7),
    centre=st.tuples(st.floats(-100, 200), st.floats(-1e7, 1e7) | st.floats(0, 60)),
)
def test_any_lens_gives_a_valid_crop_or_an_error(model, coefficients, focal, centre):
    try:
        undoing = undistortion(Camera(80, 60, focal, focal, *centre, np.eye(4)), Lens(model, coefficients))
    except PocketGSError:
        return
    assert undoing.map_x.shape == (undoing.height, undoing.width)
    assert undoing.map_x.min() > -0.5
    assert undoing.map_y.max() < 59.5
