"""COLMAP's triangulation at known poses: pairs, points, and the prior that is made of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from pocketgs.capture import Capture, Frame, open_capture
from pocketgs.capture.synthetic import true_capture
from pocketgs.errors import PocketGSError
from pocketgs.scene.point_cloud import PointCloud
from pocketgs.structure_from_motion.sparse_cloud import partners, triangulate
from pocketgs.training.options import TrainingOptions
from pocketgs.training.preparation import prepare


@given(st.integers(2, 40), st.integers(1, 50), st.integers(0, 2**32 - 1))
def test_every_frame_is_matched_with_its_nearest(count: int, most: int, seed: int) -> None:
    centres = np.random.default_rng(seed).normal(size=(count, 3))
    pairs = partners(centres, most)
    assert pairs == sorted(set(pairs))
    assert all(0 <= first < second < count for first, second in pairs)
    distances = np.linalg.norm(centres[:, None] - centres[None], axis=2) + np.diag(np.full(count, np.inf))
    for frame in range(count):
        for nearest in np.argsort(distances[frame])[: min(most, count - 1)]:
            assert (min(frame, nearest), max(frame, nearest)) in pairs
    if most >= count - 1:
        assert len(pairs) == count * (count - 1) // 2


def test_frames_at_one_place_are_matched_too() -> None:
    assert partners(np.zeros((3, 3))) == [(0, 1), (0, 2), (1, 2)]


def test_a_single_photograph_is_refused(small_capture: Capture) -> None:
    with pytest.raises(PocketGSError, match="a sparse cloud of 1 photographs"):
        triangulate(small_capture.train[:1])


def test_a_missing_pycolmap_is_said_before_the_work_starts(
    small_capture: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pocketgs.structure_from_motion.process.find_spec", lambda name: None)
    with pytest.raises(PocketGSError, match=r"pip install 'pycolmap>=4.2'"):
        triangulate(small_capture.train)


def test_photographs_of_nothing_give_no_points(small_capture: Capture) -> None:
    blank = [replace(frame, image=np.full_like(frame.image, 128)) for frame in small_capture.train[:3]]
    assert len(triangulate(blank)) == 0


@pytest.fixture(scope="module")
def three_views() -> list[Frame]:
    """The fewest that a point needs."""
    return true_capture(240, 180, frames=4, points=10).train


@pytest.mark.parametrize("by", ["mask", "alpha"])
def test_masked_pixels_give_no_points(three_views: list[Frame], by: str) -> None:
    """Three views have to see a point, so the photograph without a mask is used too."""
    frames = three_views
    half = np.arange(240) < np.full((180, 1), 120)
    left_out = {"mask": half} if by == "mask" else {"alpha": np.where(half, 255, 0).astype(np.uint8)}
    found = triangulate([frames[0], *(replace(frame, **left_out) for frame in frames[1:])], seed=3_000_000_000)
    assert len(found) > 10
    for frame in frames[1:]:
        assert frame.camera.project(found.positions)[0][:, 0].max() < 122


@pytest.mark.slow
def test_ferns_cloud_lies_where_colmap_found_it(data_folder: Path) -> None:
    capture = open_capture(data_folder / "fern", images="images_8")
    assert capture.points is not None
    frames = capture.train[:6]
    found = triangulate(frames)
    assert len(found) > 300
    # The published cloud came from full-size photographs: a surface that both saw has points of both.
    distances, _ = cKDTree(capture.points.positions).query(found.positions)
    depths = frames[0].camera.project(found.positions)[1]
    assert np.median(distances / depths) < 0.01
    seen = [frame.camera.project(found.positions) for frame in frames]
    inside = sum(
        (z > 0) & (p >= 0).all(1) & (p < [frame.camera.width, frame.camera.height]).all(1)
        for (p, z), frame in zip(seen, frames, strict=True)
    )
    assert (inside >= 2).mean() > 0.99
    again = triangulate(frames)
    np.testing.assert_array_equal(found.positions, again.positions)


def test_the_captures_own_cloud_is_taken_where_its_poses_hold(
    small_capture: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> PointCloud:
        raise AssertionError("the capture has a cloud")

    monkeypatch.setattr("pocketgs.training.preparation.triangulate", refuse)
    prior = prepare(small_capture, TrainingOptions(prior="colmap", bundle=False))
    assert small_capture.points is not None
    assert prior.points is not None
    np.testing.assert_array_equal(prior.points.positions, small_capture.points.positions)
    few = prepare(small_capture, TrainingOptions(prior="colmap", bundle=False, max_gaussians=1500))
    assert few.points is not None
    assert few.report is not None
    assert len(few.points) == few.report.points == 1500


@pytest.mark.parametrize(("own_cloud", "bundle", "needed"), [(1, 0, False), (1, 1, True), (0, 0, True), (0, 1, True)])
def test_pycolmap_is_missed_before_the_prior_starts(
    small_capture: Capture, monkeypatch: pytest.MonkeyPatch, own_cloud: int, bundle: int, needed: bool
) -> None:
    """Where it may be needed: the capture has no cloud, or the cloud does not fit refined poses."""

    class StartedError(Exception):
        pass

    def start(*_: object) -> None:
        raise StartedError

    monkeypatch.setattr("pocketgs.structure_from_motion.process.find_spec", lambda name: None)
    monkeypatch.setattr("pocketgs.training.preparation.build_prior", start)
    capture = small_capture if own_cloud else replace(small_capture, points=None)
    with pytest.raises(PocketGSError if needed else StartedError):
        prepare(capture, TrainingOptions(prior="colmap", bundle=bool(bundle)))


def test_a_capture_without_a_cloud_gets_colmaps(small_capture: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    cloud = PointCloud(np.random.default_rng(0).normal(size=(900, 3)), np.zeros((900, 3)))
    monkeypatch.setattr("pocketgs.training.preparation.triangulate", lambda frames, seed: cloud)
    prior = prepare(replace(small_capture, points=None), TrainingOptions(prior="colmap"))
    assert prior.points is cloud
