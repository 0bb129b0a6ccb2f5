"""The demo capture agrees with its own ground truth."""

from __future__ import annotations

import numpy as np
import pytest

from pocketgs.capture.capture import Capture, Frame
from pocketgs.capture.materials import value_noise
from pocketgs.capture.surfaces import Ball, Cube, Plane
from pocketgs.capture.synthetic import POINT_NOISE, demo_capture
from pocketgs.errors import PocketGSError


@pytest.fixture(scope="module")
def capture() -> Capture:
    return demo_capture(width=80, height=60, frames=10, points=900)


def test_split_and_shapes(capture: Capture) -> None:
    assert [frame.name for frame in capture.held_out] == ["0000.png", "0008.png"]
    assert len(capture.train) == 8
    assert capture.metric
    for frame in capture.frames:
        assert frame.image.shape == (60, 80, 3)
        assert frame.image.dtype == np.uint8
        assert frame.depth is not None
        assert frame.depth.shape == (60, 80)
        assert frame.depth.dtype == np.float32
        assert np.all(np.isfinite(frame.depth))
        assert np.all(frame.depth > 0)


def test_every_call_gives_the_same(capture: Capture) -> None:
    again = demo_capture(width=80, height=60, frames=10, points=900)
    for frame, twin in zip(capture.frames, again.frames, strict=True):
        np.testing.assert_array_equal(frame.image, twin.image)
    assert capture.points is not None
    assert again.points is not None
    np.testing.assert_array_equal(capture.points.positions, again.points.positions)


def test_images_have_detail(capture: Capture) -> None:
    for frame in capture.frames:
        assert frame.image.std() > 35


def surface_points(frame: Frame) -> np.ndarray:
    """World position of every pixel centre, through the public camera alone."""
    assert frame.depth is not None
    row, column = np.indices(frame.depth.shape)
    rays = np.stack([column + 0.5, row + 0.5, np.ones(frame.depth.shape)], axis=-1)
    local = rays @ np.linalg.inv(frame.camera.intrinsic_matrix).T * frame.depth[..., None]
    return (local.reshape(-1, 3) - frame.camera.world_to_camera[:3, 3]) @ frame.camera.world_to_camera[:3, :3]


def test_depth_and_colour_agree_between_views(capture: Capture) -> None:
    source, target = capture.train[3], capture.train[4]
    assert target.depth is not None
    pixels, depth = target.camera.project(surface_points(source))
    inside = (depth > 0) & np.all((pixels > 1) & (pixels < [79, 59]), axis=1)
    column, row = pixels[inside].astype(int).T
    same_surface = np.abs(target.depth[row, column] - depth[inside]) < 0.02
    assert same_surface.mean() > 0.8
    seen, expected = target.image[row, column], source.image.reshape(-1, 3)[inside]
    difference = np.abs(seen.astype(float) - expected).mean(axis=1)[same_surface]
    assert np.median(difference) < 0.5 * np.abs(expected - expected.mean(axis=0)).mean()


def test_cloud_lies_on_surfaces_that_training_frames_see(capture: Capture) -> None:
    assert capture.points is not None
    assert len(capture.points) == 900
    surfaces = np.concatenate([surface_points(frame) for frame in capture.train]).astype(np.float32)
    nearest = [np.linalg.norm(surfaces - position, axis=1).min() for position in capture.points.positions[::15]]
    assert max(nearest) < 6 * POINT_NOISE


@pytest.mark.parametrize("sizes", [{"width": 0}, {"height": -1}, {"frames": 1}, {"points": 0}])
def test_rejects_empty_captures(sizes: dict[str, int]) -> None:
    with pytest.raises(PocketGSError, match="expected at least"):
        demo_capture(**sizes)


def column(*values: float) -> np.ndarray:
    return np.array(values, np.float32)[:, None]


def black(points: np.ndarray) -> np.ndarray:
    return np.zeros_like(points)


@pytest.mark.parametrize(
    "surface",
    [
        Plane(column(0, 0, 1), column(0, 0, -1), black),
        Ball(column(0, 0, 2), 1.0, black),
        Cube(column(0, 0, 2), 1.0, np.eye(3, dtype=np.float32), black),
    ],
)
def test_surfaces_are_hit_from_the_front_only(surface: Plane | Ball | Cube) -> None:
    towards, away = column(0.01, 0.02, 1), column(0.01, 0.02, -1)
    distance = surface.hit(column(0, 0, 0), np.hstack([towards, away]))
    assert distance[0] == pytest.approx(1, abs=1e-3)
    assert np.isinf(distance[1])
    np.testing.assert_allclose(surface.normals(distance[0] * towards), column(0, 0, -1), atol=0.03)
    assert np.isinf(surface.hit(column(0, 0, 5), towards)[0])


def test_value_noise_is_smooth_and_bounded() -> None:
    line = np.linspace(-3, 3, 6001, dtype=np.float32)
    noise = value_noise(np.stack([line, line * 0.5, -line]))
    assert noise.min() >= 0
    assert noise.max() <= 1
    assert np.abs(np.diff(noise)).max() < 0.01
    assert noise.std() > 0.1
