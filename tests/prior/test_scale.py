"""The scale of a scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pocketgs.capture.capture import Capture, Frame
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera, look_at
from pocketgs.prior.scale import METRIC_DISTANCE, estimate_scale
from pocketgs.scene.point_cloud import PointCloud

FOCUS = np.array([1.0, 2.0, 3.0])


def camera_at(eye: np.ndarray, target: np.ndarray) -> Camera:
    return Camera(64, 48, 60.0, 60.0, 32.0, 24.0, look_at(eye, target, np.array([0.0, 0.0, 1.0])))


def ring(radius: float, outwards: bool = False) -> list[Camera]:
    """Cameras around `FOCUS` that look at it, or away from it."""
    angles = np.arange(8) * np.pi / 4
    offsets = radius * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    return [camera_at(FOCUS + offset, FOCUS + (2 if outwards else 0) * offset) for offset in offsets]


def capture_of(train: Sequence[Camera], held_out: Sequence[Camera] = (), metric: bool = False) -> Capture:
    image = np.zeros((48, 64, 3), np.uint8)

    def frames(cameras: Sequence[Camera], prefix: str) -> list[Frame]:
        return [Frame(f"{prefix}{index}.png", camera, image) for index, camera in enumerate(cameras)]

    return Capture("views", Path("views"), "test", frames(train, ""), frames(held_out, "held_out_"), metric=metric)


def test_cameras_around_a_thing_tell_how_far_it_is() -> None:
    scale = estimate_scale(capture_of(ring(3.0)))
    assert scale.distance == pytest.approx(3.0)
    assert scale.unit == scale.distance


def test_metres_stay_metres() -> None:
    scale = estimate_scale(capture_of(ring(3.0), metric=True))
    assert scale.distance == pytest.approx(3.0)
    assert scale.unit == 1.0


def test_held_out_cameras_do_not_count() -> None:
    assert estimate_scale(capture_of(ring(3.0), ring(300.0))).distance == pytest.approx(3.0)


@settings(max_examples=30)
@given(factor=st.floats(1e-3, 1e3), outwards=st.booleans())
def test_distance_grows_with_the_scene(factor: float, outwards: bool) -> None:
    once, grown = (estimate_scale(capture_of(ring(radius, outwards))) for radius in (1.0, factor))
    assert grown.distance == pytest.approx(factor * once.distance, rel=1e-6)


def test_cameras_that_look_apart_are_given_a_room_in_metres() -> None:
    assert estimate_scale(capture_of(ring(3.0, outwards=True), metric=True)).distance == METRIC_DISTANCE


WITHOUT_A_FOCUS = {
    "one camera": ring(3.0)[:1],
    "parallel axes": [camera_at(np.array([x, 0.0, 0.0]), np.array([x, 5.0, 0.0])) for x in (0.0, 1.0, 2.0)],
    "one place": [
        camera_at(FOCUS, FOCUS + offset) for offset in np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    ],
    "outwards": ring(3.0, outwards=True),
}
"""Cameras whose optical axes say nothing about the scene."""


def before(cameras: Sequence[Camera], depth: float) -> PointCloud:
    """Points at a depth in the images of all cameras, and one behind each, farther away."""
    pixels = np.random.default_rng(0).uniform((4, 4), (60, 44), (30, 2))
    seen = [camera.centre + depth * camera.rays(pixels) for camera in cameras]
    behind = [[camera.centre - 1000 * camera.forward] for camera in cameras]
    positions = np.concatenate([*seen, *behind])
    return PointCloud(positions, np.zeros_like(positions))


@pytest.mark.parametrize("depth", [0.2, 40.0])
@pytest.mark.parametrize("cameras", WITHOUT_A_FOCUS.values(), ids=WITHOUT_A_FOCUS)
def test_where_axes_say_nothing_the_captures_own_points_do(cameras: list[Camera], depth: float) -> None:
    scale = estimate_scale(replace(capture_of(cameras), points=before(cameras, depth)))
    assert scale.distance == pytest.approx(depth, rel=1e-3)
    assert scale.unit == scale.distance


def test_points_do_not_count_where_axes_meet_or_lengths_are_metres() -> None:
    points = before(ring(3.0), 20.0)
    assert estimate_scale(replace(capture_of(ring(3.0)), points=points)).distance == pytest.approx(3.0)
    for cameras in WITHOUT_A_FOCUS.values():
        capture = capture_of(cameras, metric=True)
        assert estimate_scale(replace(capture, points=before(cameras, 20.0))) == estimate_scale(capture)


def test_points_that_no_camera_sees_tell_nothing() -> None:
    cameras = WITHOUT_A_FOCUS["parallel axes"]
    unseen = PointCloud(np.array([[0.0, -9.0, 0.0]]), np.zeros((1, 3)))
    assert estimate_scale(replace(capture_of(cameras), points=unseen)) == estimate_scale(capture_of(cameras))


@pytest.mark.parametrize("metric", [False, True])
@pytest.mark.parametrize("cameras", WITHOUT_A_FOCUS.values(), ids=WITHOUT_A_FOCUS)
def test_what_tells_nothing_still_gives_a_positive_scale(cameras: list[Camera], metric: bool) -> None:
    scale = estimate_scale(capture_of(cameras, metric=metric))
    assert np.isfinite([scale.distance, scale.unit]).all()
    assert scale.distance > 0
    assert scale.unit > 0


def test_no_cameras_are_refused() -> None:
    with pytest.raises(PocketGSError, match="no cameras"):
        estimate_scale(capture_of([], ring(3.0)))
