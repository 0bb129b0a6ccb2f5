"""Photographs look alike around points under true poses, and less so under others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pocketgs.capture.capture import Capture, Frame
from pocketgs.geometry.camera import Camera
from pocketgs.prior.features.observations import Observations
from pocketgs.prior.poses.photometric import correlations
from prior.bundle_problem import turned_and_moved


@pytest.fixture(scope="module")
def frames(clean_walk: Capture) -> list[Frame]:
    return clean_walk.train[::2]


def surface_points(frames: list[Frame], count: int = 400) -> tuple[Observations, np.ndarray]:
    """Observations of points on the surfaces that the first photograph shows, and their positions."""
    camera, depth = frames[0].camera, frames[0].depth
    assert depth is not None
    rng = np.random.default_rng(0)
    pixels = rng.uniform((20, 20), (camera.width - 20, camera.height - 20), (count, 2))
    columns, rows = pixels.astype(int).T
    positions = camera.centre + camera.rays(pixels) * depth[rows, columns][:, None]
    seen = []
    for view, frame in enumerate(frames):
        where, away = frame.camera.project(positions)
        inside = np.flatnonzero((away > 0) & frame.camera.contains(where))
        seen += [(number, view, *where[number]) for number in inside.tolist()]
    table = np.array(sorted(seen))
    tracks = Observations(table[:, 1].astype(np.int32), table[:, 0].astype(np.int32), table[:, 2:])
    return tracks, positions[tracks.point]


def mean_likeness(frames: list[Frame], cameras: list[Camera]) -> float:
    tracks, points = surface_points(frames)
    return float(np.nanmean(correlations(cameras, [frame.image for frame in frames], tracks, points)))


def test_true_poses_make_photographs_most_alike(frames: list[Frame]) -> None:
    true = [frame.camera for frame in frames]
    means = [mean_likeness(frames, true)]
    for turn in (0.003, 0.01, 0.03):
        rng = np.random.default_rng(1)
        means.append(
            mean_likeness(frames, [turned_and_moved(each, rng.normal(0, turn, 3), np.zeros(3)) for each in true])
        )
    assert means == sorted(means, reverse=True)
    assert means[3] < 0.5 * means[0]


def test_what_cannot_be_compared_is_unknown(frames: list[Frame]) -> None:
    tracks, points = surface_points(frames)
    cameras, images = [frame.camera for frame in frames], [frame.image for frame in frames]
    assert np.isnan(correlations(cameras, images, tracks, np.full_like(points, np.nan))).all()
    behind = cameras[0].centre - cameras[0].forward
    assert np.isnan(correlations(cameras, images, tracks, np.broadcast_to(behind, points.shape))).all()
    flat = [np.full_like(image, 128) for image in images]
    assert np.isnan(correlations(cameras, flat, tracks, points)).all()


def test_at_most_a_number_of_observations_is_compared(frames: list[Frame], monkeypatch: pytest.MonkeyPatch) -> None:
    tracks, points = surface_points(frames)
    cameras, images = [frame.camera for frame in frames], [frame.image for frame in frames]
    every = correlations(cameras, images, tracks, points)
    monkeypatch.setattr("pocketgs.prior.poses.photometric.MOST", 100)
    some = correlations(cameras, images, tracks, points)
    known = np.isfinite(some)
    assert 0 < known.sum() <= 100 < np.isfinite(every).sum()
    np.testing.assert_array_equal(some[known], every[known])


def test_exposure_does_not_matter(frames: list[Frame]) -> None:
    darker = [
        replace(frame, image=(frame.image * (0.6 + 0.1 * (i % 3))).astype(np.uint8)) for i, frame in enumerate(frames)
    ]
    true = [frame.camera for frame in frames]
    assert abs(mean_likeness(darker, true) - mean_likeness(frames, true)) < 0.03
