"""Points drawn for captures without a cloud: near surfaces, inside silhouettes, the same every time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pocketgs import Camera, Capture, Frame, PocketGSError
from pocketgs.geometry.camera import look_at
from pocketgs.prior.cloud.volume import draw_points

RADIUS = 0.5


def ring(count: int, distance: float, outwards: bool = False, size: int = 48) -> list[Camera]:
    """Cameras on a circle that look at its centre, or away from it, some higher than others."""
    cameras = []
    for number in range(count):
        turn = 2 * np.pi * number / count
        direction = np.array([np.cos(turn), np.sin(turn), 0.4 * (-1) ** number])
        eye = distance * direction / np.linalg.norm(direction)
        target = 2 * eye if outwards else np.zeros(3)
        cameras.append(
            Camera(size, size, 1.2 * size, 1.2 * size, size / 2, size / 2, look_at(eye, target, np.eye(3)[2]))
        )
    return cameras


def photograph_of_a_ball(camera: Camera, colour: tuple[int, int, int]) -> Frame:
    """RGBA of a plain ball about the origin, laid on black."""
    row, column = np.indices((camera.height, camera.width)) + 0.5
    local = np.stack([(column - camera.cx) / camera.fx, (row - camera.cy) / camera.fy, np.ones_like(row)], axis=2)
    rays = (local / np.linalg.norm(local, axis=2, keepdims=True)) @ camera.world_to_camera[:3, :3]
    along = rays @ -camera.centre
    nearest = np.sqrt(np.maximum(camera.centre @ camera.centre - along**2, 0))
    alpha = np.where(nearest <= RADIUS, 255, 0).astype(np.uint8)
    image = np.where(alpha[..., None] > 0, np.array(colour, np.uint8), np.uint8(0))
    return Frame("ball", camera, image, alpha=alpha)


def distance_to_surface(positions: np.ndarray, frames: list[Frame]) -> np.ndarray:
    """Distances of points from the frames' surfaces, along the optical axis of the best frame."""
    best = np.full(len(positions), np.inf)
    for frame in frames:
        assert frame.depth is not None
        pixels, depth = frame.camera.project(positions.astype(np.float64))
        column, row = np.floor(pixels).astype(int).T
        inside = (depth > 0) & (column >= 0) & (column < frame.camera.width) & (row >= 0) & (row < frame.camera.height)
        true = frame.depth[row[inside], column[inside]]
        best[inside] = np.minimum(best[inside], np.abs(depth[inside] - true))
    return best


def test_points_lie_nearer_to_the_surface_than_uniform_ones(small_capture: Capture) -> None:
    points = draw_points(small_capture.train, 2000)
    assert len(points) == 2000
    assert small_capture.points is not None
    low, high = np.quantile(small_capture.points.positions, [0.01, 0.99], axis=0)
    uniform = np.random.default_rng(0).uniform(low, high, (2000, 3))
    drawn_error = distance_to_surface(points.positions, small_capture.train)
    uniform_error = distance_to_surface(uniform, small_capture.train)
    assert np.median(drawn_error) < 0.2 * np.median(uniform_error)
    # Few are far off, because rays without a clear choice of depth are dropped.
    assert np.quantile(drawn_error, 0.9) < 0.45


def test_points_have_the_colours_of_the_photographs(small_capture: Capture) -> None:
    points = draw_points(small_capture.train, 2000)
    assert points.colours.min() >= 0
    assert points.colours.max() <= 1
    frame = small_capture.train[3]
    pixels, depth = frame.camera.project(points.positions.astype(np.float64))
    column, row = np.floor(pixels).astype(int).T
    inside = (depth > 0) & (column >= 0) & (column < 96) & (row >= 0) & (row < 72)
    shown = frame.image[row[inside], column[inside]] / 255
    similar = np.abs(shown - points.colours[inside]).mean()
    shuffled = np.abs(np.random.default_rng(0).permutation(shown) - points.colours[inside]).mean()
    assert similar < 0.4 * shuffled


def test_silhouettes_bound_the_volume() -> None:
    colour = (200, 100, 50)
    frames = [photograph_of_a_ball(camera, colour) for camera in ring(12, 2.0)]
    points = draw_points(frames, 1000)
    assert len(points) == 1000
    for frame in frames:
        pixels, depth = frame.camera.project(points.positions.astype(np.float64))
        column, row = np.floor(pixels).astype(int).T
        assert np.all(depth > 0)
        assert np.all(frame.alpha[row, column] > 0)
    assert np.linalg.norm(points.positions, axis=1).max() < 1.3 * RADIUS
    np.testing.assert_allclose(points.colours, np.tile(np.array(colour) / 255, (1000, 1)), atol=1e-6)


def test_the_same_every_time(small_capture: Capture) -> None:
    one, same, other = (draw_points(small_capture.train, 300, seed) for seed in (5, 5, 6))
    assert one.positions.tobytes() == same.positions.tobytes()
    assert one.colours.tobytes() == same.colours.tobytes()
    assert one.positions.tobytes() != other.positions.tobytes()


@pytest.mark.parametrize("count", [4, 5, 100])
def test_as_many_as_wanted(small_capture: Capture, count: int) -> None:
    assert len(draw_points(small_capture.train, count)) == count


def test_one_frame_shows_no_volume(small_capture: Capture) -> None:
    with pytest.raises(PocketGSError, match="no volume is seen by several of the 1 cameras"):
        draw_points(small_capture.train[:1], 200)


def test_cameras_that_look_apart() -> None:
    frames = [Frame("", camera, np.zeros((48, 48, 3), np.uint8)) for camera in ring(8, 1.0, outwards=True)]
    with pytest.raises(PocketGSError, match="the 8 cameras face outwards"):
        draw_points(frames, 100)


def test_masked_pixels_are_not_drawn(small_capture: Capture) -> None:
    mask = np.zeros((72, 96), bool)
    mask[:, :48] = True
    frames = [replace(frame, mask=mask) for frame in small_capture.train]
    points = draw_points(frames, 300)
    drawn_here = np.zeros(len(points), bool)
    for frame in frames:
        pixels, depth = frame.camera.project(points.positions.astype(np.float64))
        drawn_here |= (depth > 0) & (pixels[:, 0] >= 0) & (pixels[:, 0] < 48)
    assert drawn_here.all()


def test_what_masks_leave_out_is_not_compared(small_capture: Capture) -> None:
    mask = np.ones((72, 96), bool)
    mask[:, 30:60] = False
    frames = [replace(frame, mask=mask) for frame in small_capture.train]
    noise = np.random.default_rng(5).integers(0, 255, (72, 96, 3), dtype=np.uint8)
    spoilt = [replace(frame, image=np.where(mask[..., None], frame.image, noise)) for frame in frames]
    columns = np.flatnonzero(mask[0])
    points, others = draw_points(frames, 300), draw_points(spoilt, 300)
    assert len(columns) == 66
    np.testing.assert_array_equal(points.positions, others.positions)


def test_silhouettes_of_nothing() -> None:
    frames = [photograph_of_a_ball(camera, (9, 9, 9)) for camera in ring(6, 2.0)]
    frames = [replace(frame, alpha=np.zeros((48, 48), np.uint8)) for frame in frames]
    with pytest.raises(PocketGSError, match="no volume"):
        draw_points(frames, 100)


def test_no_frames() -> None:
    with pytest.raises(PocketGSError, match="no cameras"):
        draw_points([], 100)
