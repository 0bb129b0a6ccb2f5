"""The visual hull: points that some image with alpha shows nothing at are outside."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pocketgs import Camera
from pocketgs.capture.capture import Frame
from pocketgs.geometry.camera import look_at
from pocketgs.prior.cloud.visual_hull import JUDGING_POINTS, _seen_and_transparent, outside_hull

SIZE = 40


def view_of_a_ball(*eye: float) -> Frame:
    """A camera at `eye` whose alpha is the silhouette of the unit ball."""
    pose = look_at(np.array(eye), np.zeros(3), np.array([0.1, 0.9, 0.3]))
    camera = Camera(SIZE, SIZE, 40.0, 40.0, SIZE / 2, SIZE / 2, pose)
    rows, columns = np.mgrid[0:SIZE, 0:SIZE]
    rays = np.stack([(columns + 0.5 - camera.cx) / 40, (rows + 0.5 - camera.cy) / 40, np.ones(rows.shape)], axis=2)
    middle = pose[:3, 3]
    along = rays @ middle / np.linalg.norm(rays, axis=2)
    alpha = np.where(middle @ middle - along**2 < 1, 255, 0).astype(np.uint8)
    return Frame("a", camera, np.zeros((SIZE, SIZE, 3), np.uint8), alpha=alpha)


@pytest.fixture
def views() -> list[Frame]:
    return [view_of_a_ball(*eye) for eye in [(4, 0, 0), (0, 4, 0), (0, 0, 4), (-3, -3, 0)]]


def test_points_of_a_ball(views: list[Frame]) -> None:
    points = np.random.default_rng(0).uniform(-1.4, 1.4, (2000, 3))
    radius = np.linalg.norm(points, axis=1)
    outside = outside_hull(points, views)
    # Up to a pixel, which is a tenth there.
    assert not outside[radius < 0.9].any()
    for frame in views:
        eye = frame.camera.centre
        distance = np.linalg.norm(eye)
        along = (eye - points) @ eye / distance
        slope = np.linalg.norm(np.cross(points - eye, eye), axis=1) / (distance * along)
        edge = np.tan(np.arcsin(1 / distance))
        # The image reaches to slopes of 0.5.
        assert outside[(slope > edge + 0.05) & (slope < 0.45)].all()
    assert outside_hull(points, views[:1]).sum() < outside.sum()


def test_points_that_are_outside_are_not_looked_at_again(views: list[Frame], monkeypatch: pytest.MonkeyPatch) -> None:
    points = np.random.default_rng(0).uniform(-1.4, 1.4, (2 * JUDGING_POINTS, 3))
    expected = np.any([_seen_and_transparent(frame, points)[1] for frame in views], axis=0)
    asked: list[int] = []

    def counted(frame: Frame, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        asked.append(len(points))
        return _seen_and_transparent(frame, points)

    monkeypatch.setattr("pocketgs.prior.cloud.visual_hull._seen_and_transparent", counted)
    np.testing.assert_array_equal(outside_hull(points, views), expected)
    assert len(points) == asked[len(views)] > asked[len(views) + 1] > asked[len(views) + 2] > asked[-1]


def test_who_does_not_see_a_point_has_no_say(views: list[Frame]) -> None:
    behind_and_beside = np.array([[9.0, 0, 0], [0, 0, 30.0]])
    assert not outside_hull(behind_and_beside, views[:1]).any()


def test_frames_without_alpha_have_no_say(views: list[Frame]) -> None:
    points = np.array([[0, 0, 1.3], [0, 1.2, 0]])
    assert outside_hull(points, views).all()
    assert not outside_hull(points, [replace(frame, alpha=None) for frame in views]).any()
    assert not outside_hull(points, []).any()


@pytest.mark.parametrize("shown", [0, 5])
def test_a_frame_that_lost_the_object_has_no_say(views: list[Frame], shown: int) -> None:
    points = np.random.default_rng(0).uniform(-1.4, 1.4, (30_000, 3))
    alpha = np.zeros((SIZE, SIZE), np.uint8)
    alpha[:, :shown] = 255
    lost = replace(view_of_a_ball(3, 0, 3), alpha=alpha)
    np.testing.assert_array_equal(outside_hull(points, [*views, lost]), outside_hull(points, views))


def test_hardly_visible_is_not_nothing(views: list[Frame]) -> None:
    faint = replace(views[0], alpha=np.full((SIZE, SIZE), 1, np.uint8))
    assert not outside_hull(np.array([[0, 0, 1.3]]), [faint]).any()


def test_no_points(views: list[Frame]) -> None:
    assert outside_hull(np.zeros((0, 3)), views).shape == (0,)
