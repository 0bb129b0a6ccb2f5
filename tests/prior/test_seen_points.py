"""Points that frames see: of a cloud, or of sweeps of small copies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pocketgs.capture.capture import Capture
from pocketgs.capture.synthetic import true_capture
from pocketgs.prior.depth.cpu.stereo import CpuStereo
from pocketgs.prior.depth.sweep import SweepSettings
from pocketgs.prior.poses.structure import StructureSettings
from pocketgs.prior.prior import PriorSettings, build_prior
from pocketgs.prior.rough_points import rough_points
from pocketgs.prior.scale import estimate_scale
from pocketgs.prior.seen_points import MAX_SEEN, seen_points
from pocketgs.scene.point_cloud import PointCloud


@pytest.fixture(scope="module")
def room() -> Capture:
    return true_capture(width=64, height=48, frames=6, points=1500)


def test_points_in_view_are_seen_unless_something_hides_them(room: Capture) -> None:
    assert room.points is not None
    for frame, points in zip(room.train, seen_points(room.points, room.train), strict=True):
        assert frame.depth is not None
        pixels, depth = frame.camera.project(room.points.positions)
        inside = (depth > 0) & np.all((pixels >= 0) & (pixels < (64, 48)), axis=1)
        columns, rows = pixels[inside].astype(int).T
        in_front = depth[inside] < 1.05 * frame.depth[rows, columns]
        expected = set(map(tuple, room.points.positions[inside][in_front]))
        found = set(map(tuple, points))
        assert len(found & expected) > 0.85 * len(expected)  # not all beside the edge of something nearer
        assert len(found - expected) < 0.1 * len(found)


def test_transparent_parts_show_nothing(room: Capture) -> None:
    assert room.points is not None
    frame = replace(room.train[0], alpha=np.where(np.arange(64) < 32, 0, 255).astype(np.uint8)[None].repeat(48, 0))
    (points,) = seen_points(room.points, [frame])
    assert frame.camera.project(points)[0][:, 0].min() > 31


def test_of_large_clouds_some_are_returned(room: Capture) -> None:
    wall = np.random.default_rng(0).uniform(-1, 1, (60_000, 3)) * [1, 1, 0]
    pose = np.eye(4)
    pose[2, 3] = 3.0
    camera = replace(room.train[0].camera, world_to_camera=pose)
    (points,) = seen_points(PointCloud(wall, np.zeros_like(wall)), [replace(room.train[0], camera=camera, depth=None)])
    assert len(points) == MAX_SEEN


def test_rough_points_lie_on_the_surfaces(room: Capture) -> None:
    distance = estimate_scale(room).distance
    for frame, points in zip(room.train, rough_points(room.train, distance, SweepSettings(), CpuStereo()), strict=True):
        assert frame.depth is not None
        pixels, depth = frame.camera.project(points)
        columns, rows = pixels.astype(int).T
        assert len(points) > 500
        assert np.mean(np.abs(depth / frame.depth[rows, columns] - 1) < 0.1) > 0.6


def test_without_features_the_own_cloud_gives_the_depths_to_sweep(room: Capture) -> None:
    no_features = PriorSettings(structure=StructureSettings(bundle=False, fewest_points=10**9), exposure="off")
    with_cloud = build_prior(room, 2000, no_features)
    assert with_cloud.report is not None
    assert with_cloud.report.coverage_known is not None
    assert with_cloud.report.coverage_known > 0.9
