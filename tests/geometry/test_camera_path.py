"""The focus point of cameras, and camera paths."""

from __future__ import annotations

import numpy as np
import pytest

from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera, look_at
from pocketgs.geometry.camera_geometry import focus_point, looks_at, upward
from pocketgs.geometry.camera_path import orbit, path
from pocketgs.viewer.content import View, looked_at

UP = np.array([0.0, 0.0, 1.0])
TARGET = np.array([1.0, -2.0, 0.5])


def camera_at(eye: np.ndarray, target: np.ndarray) -> Camera:
    return Camera(64, 48, 60.0, 60.0, 32.0, 24.0, look_at(np.asarray(eye, dtype=float), target, UP))


def ring(azimuths: np.ndarray, elevation: float = 0.5, distance: float = 3.0) -> list[Camera]:
    """Cameras around TARGET that look at it."""
    flat = distance * np.cos(elevation)
    height = np.full_like(azimuths, distance * np.sin(elevation))
    offsets = np.stack([flat * np.cos(azimuths), flat * np.sin(azimuths), height], axis=1)
    return [camera_at(TARGET + offset, TARGET) for offset in offsets]


def grid() -> list[Camera]:
    """Cameras in a plane that look along y at (0, 40, 0), nearly parallel, as in a light-field capture."""
    return [camera_at(np.array([x, 0, z]), np.array([0, 40.0, 0])) for x in (-4, 0, 4) for z in (-1, 1)]


def offsets_of(cameras: list[Camera], target: np.ndarray) -> np.ndarray:
    return np.array([camera.centre for camera in cameras]) - target


def assert_looking_at(cameras: list[Camera], target: np.ndarray) -> None:
    for camera in cameras:
        pixel, depth = camera.project(target[None])
        assert depth[0] > 0
        np.testing.assert_allclose(pixel[0], [camera.cx, camera.cy], atol=1e-6)
        assert -camera.world_to_camera[1, :3] @ UP > 0


def test_focus_is_where_axes_meet() -> None:
    cameras = ring(np.linspace(0, 2, 5))
    np.testing.assert_allclose(focus_point(cameras), TARGET, atol=1e-9)
    np.testing.assert_allclose(focus_point(grid()), [0, 40, 0], atol=1e-6)


def test_focus_of_one_camera_lies_before_it() -> None:
    camera = camera_at(np.zeros(3), TARGET)
    np.testing.assert_allclose(focus_point([camera]), camera.forward, atol=1e-9)


def test_focus_of_parallel_cameras_lies_before_them() -> None:
    cameras = [camera_at(np.array([x, 0, 0]), np.array([x, 1.0, 0])) for x in (-1.0, 1.0)]
    np.testing.assert_allclose(focus_point(cameras), [0, 4, 0], atol=1e-9)


def test_looks_at_tells_inwards_from_outwards() -> None:
    inwards = ring(np.linspace(0, 5, 6))
    outwards = [camera_at(camera.centre, 2 * camera.centre - TARGET) for camera in inwards]
    assert looks_at(inwards, TARGET)
    assert not looks_at(outwards, TARGET)
    np.testing.assert_allclose(focus_point(outwards), TARGET, atol=1e-9)


@pytest.mark.parametrize("place", [TARGET, np.zeros(3)])
@pytest.mark.parametrize("seed", range(10))
def test_cameras_in_one_place_look_at_nothing_in_common(place: np.ndarray, seed: int) -> None:
    """Their axes meet where they stand, and rounding decides on which side of each."""
    rng = np.random.default_rng(seed)
    cameras = [camera_at(place, place + rng.normal(size=3) * (1, 1, 0.1)) for _ in range(9)]
    assert not looks_at(cameras, focus_point(cameras))
    target = np.array(looked_at([View(str(i), camera, False) for i, camera in enumerate(cameras)])[1])
    assert np.linalg.norm(target - place) == pytest.approx(1.0)


def test_upward() -> None:
    np.testing.assert_allclose(upward(ring(2 * np.pi * np.arange(5) / 5)), UP, atol=1e-9)


def test_orbit_of_a_surrounding_capture_is_a_full_circle() -> None:
    orbiting = orbit(ring(2 * np.pi * np.arange(8) / 8), 12)
    offsets = offsets_of(orbiting, TARGET)
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), 3)
    np.testing.assert_allclose(offsets[:, 2], 3 * np.sin(0.5))
    turns = np.diff(np.unwrap(np.arctan2(offsets[:, 1], offsets[:, 0])))
    np.testing.assert_allclose(turns, np.pi / 6)
    assert_looking_at(orbiting, TARGET)


def test_orbit_of_a_forward_facing_capture_stays_among_its_cameras() -> None:
    focus = np.array([0, 40.0, 0])
    swaying = orbit(grid(), 40)
    eyes = np.array([camera.centre for camera in swaying])
    assert 3 < eyes[:, 0].max() < 5
    assert -5 < eyes[:, 0].min() < -3
    assert 0.9 < eyes[:, 2].max() < 1.5
    assert np.abs(eyes[:, 1]).max() < 0.5
    assert_looking_at(swaying, focus)


def test_orbit_of_an_arc_stays_on_it() -> None:
    swaying = orbit(ring(np.linspace(-1, 1, 9) + np.pi), 30)
    offsets = offsets_of(swaying, TARGET)
    azimuths = np.arctan2(offsets[:, 1], -offsets[:, 0])
    assert np.abs(azimuths).max() < 1
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), 3)


def test_orbit_around_a_given_focus() -> None:
    focus = np.array([0, 20.0, 0])
    assert_looking_at(orbit(grid(), 5, focus), focus)


def test_a_focus_where_a_camera_is() -> None:
    cameras = ring(np.linspace(0, 2 * np.pi, 8, endpoint=False))
    with pytest.raises(PocketGSError, match="camera 3 is at the focus"):
        orbit(cameras, 5, cameras[3].centre)


def test_orbit_of_one_camera_sways() -> None:
    camera = camera_at(np.zeros(3), TARGET)
    eyes = np.array([made.centre for made in orbit([camera], 8)])
    assert 0.02 < np.linalg.norm(eyes, axis=1).max() < 0.1


def test_orbit_of_cameras_that_look_straight_down() -> None:
    pose = look_at(np.array([0, 0, 5.0]), np.zeros(3), np.array([0, 1.0, 0]))
    made = orbit([Camera(64, 48, 60.0, 60.0, 32.0, 24.0, pose)], 4)
    assert all(camera.forward @ [0, 0, -1] > 0.99 for camera in made)


@pytest.mark.parametrize("headings", [(0, 0.3, -0.3), (0, 1.5, 3), (0, 0.1, 0.2)])
@pytest.mark.parametrize("count", [12, 30])
def test_orbit_above_a_capture_from_overhead(headings: tuple[float, ...], count: int) -> None:
    """A drone's photographs in a line: the orbit is as high as they are, and does not reach the point above them."""
    cameras = []
    for x, heading in zip((-10, 0, 10), headings, strict=True):
        eye, heading_vector = np.array([x, 0, 50.0]), np.array([np.cos(heading), np.sin(heading), 0])
        cameras.append(Camera(64, 48, 60.0, 60.0, 32.0, 24.0, look_at(eye, eye - [0, 0, 50], heading_vector)))
    made = orbit(cameras, count)
    assert len(made) == count
    assert all(camera.forward @ [0, 0, -1] > 0.9 for camera in made)


def test_orbit_of_outward_cameras_goes_through_them() -> None:
    outwards = [camera_at(camera.centre, 2 * camera.centre - TARGET) for camera in ring(np.arange(6.0))]
    made = orbit(outwards, 12)
    for camera, given in zip(made[::2], outwards, strict=True):
        np.testing.assert_allclose(camera.world_to_camera, given.world_to_camera, atol=1e-9)


def test_open_path_passes_through_its_cameras() -> None:
    cameras = ring(np.array([0.0, 0.4, 1.0, 1.1]))
    made = path(cameras, 7)
    for camera, given in zip(made[::2], cameras, strict=True):
        np.testing.assert_allclose(camera.world_to_camera, given.world_to_camera, atol=1e-9)


@pytest.mark.parametrize("closed", [False, True])
def test_path_is_smooth(closed: bool) -> None:
    made = path(ring(2 * np.pi * np.arange(5) / 5), 200, closed)
    poses = np.array([camera.camera_to_world for camera in (made + made[:2] if closed else made)])
    speed = np.diff(poses, axis=0)
    assert np.abs(np.diff(speed, axis=0)).max() < 0.1 * np.abs(speed).max()


def test_path_through_one_or_two_cameras() -> None:
    first, second = ring(np.array([0.0, 0.5]))
    assert path([first], 3) == [first] * 3
    np.testing.assert_allclose(path([first, second], 3)[1].centre, (first.centre + second.centre) / 2)
    assert len(path([first, second], 5, closed=True)) == 5


@pytest.mark.parametrize("make", [orbit, path])
def test_nothing_to_go_by(make) -> None:
    with pytest.raises(PocketGSError, match="no cameras"):
        make([], 5)
    with pytest.raises(PocketGSError, match="expected at least 1"):
        make(grid(), 0)
    with pytest.raises(PocketGSError, match="no cameras"):
        focus_point([])
