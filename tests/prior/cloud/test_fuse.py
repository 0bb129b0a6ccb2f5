"""Fusion: consistency of depth maps, and clouds from exact depths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pocketgs import Camera, PointCloud
from pocketgs.capture.capture import Capture, Frame
from pocketgs.capture.synthetic import true_capture
from pocketgs.prior.cloud.cpu.merger import CpuMerger
from pocketgs.prior.cloud.fuse import SHELL_EXTENT, FusionSettings, fuse, views_of
from pocketgs.prior.cloud.merge import Candidates
from pocketgs.prior.depth.consistency import AROUND, COHERENT_STEPS, CONFIRMED, SweptViews
from pocketgs.prior.depth.cpu.consistency import compare_depths
from pocketgs.prior.depth.cpu.stereo import CpuStereo
from pocketgs.prior.depth.source_views import LEAST_PARALLAX
from pocketgs.prior.depth.sweep import DepthMap
from prior.random_depth_maps import random_views, with_copy

SETTINGS = FusionSettings()


@pytest.fixture(scope="module")
def table() -> Capture:
    """Seven training views of the demo scene, with exact poses and depths."""
    return true_capture(160, 120, frames=8, points=10)


@pytest.fixture(scope="module")
def exact(table: Capture) -> list[DepthMap]:
    return [certain(frame.depth) for frame in table.train if frame.depth is not None]


def certain(depth: np.ndarray, step: float = 1e-5) -> DepthMap:
    return DepthMap(depth, np.ones(depth.shape, np.float32), step)


def cloud_of(keyframes: list[Frame], maps: list[DepthMap], frames: list[Frame], count: int) -> PointCloud:
    return CpuMerger().merged(fuse(keyframes, maps, frames, SETTINGS, CpuStereo()), count)


def cameras_of(views: SweptViews) -> list[Camera]:
    poses = np.tile(np.eye(4), (len(views.depths), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = views.rotations, views.translations
    return [
        Camera(int(size[1]), int(size[0]), *map(float, intrinsics), pose)
        for size, intrinsics, pose in zip(views.sizes, views.intrinsics, poses, strict=True)
    ]


def unprojected(camera: Camera, row: int, column: int, depth: float) -> np.ndarray:
    local = [(column + 0.5 - camera.cx) / camera.fx, (row + 0.5 - camera.cy) / camera.fy, 1.0]
    return camera.centre + depth * np.array(local) @ camera.world_to_camera[:3, :3]


def twin(views: SweptViews, view: int, tolerance: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The result by the definition of `compare_depths`, pixel by pixel."""
    cameras = cameras_of(views)
    height, width = views.sizes[view]
    agreeing, contradicting, footprints = np.zeros((3, height, width))
    depths = views.depths[view, :height, :width]
    typical = np.median(depths[depths > 0])
    for row, column in np.ndindex(height, width):
        depth = float(views.depths[view, row, column])
        if depth == 0:
            continue
        point = unprojected(cameras[view], row, column, depth)
        covered = [depth / cameras[view].fx]
        for other, camera in enumerate(cameras):
            (pixel,), (distance,) = camera.project(point[None])
            if other == view or distance <= 0 or np.any(pixel < 0) or np.any(pixel >= views.sizes[other][::-1]):
                continue
            theirs = views.depths[other, int(pixel[1]), int(pixel[0])]
            step = max(views.steps[view], views.steps[other])
            indistinct = max(0.5, min(1.0, step * distance)) * step * distance * theirs
            baseline = np.linalg.norm(camera.centre - cameras[view].centre)
            if theirs > 0 and abs(distance - theirs) < max(tolerance * distance, indistinct):
                if baseline >= LEAST_PARALLAX * min(depth, typical):
                    agreeing[row, column] += 1
                    covered.append(distance / camera.fx)
            elif theirs > distance:
                contradicting[row, column] += 1
        around = depths[max(row - AROUND, 0) : row + AROUND + 1, max(column - AROUND, 0) : column + AROUND + 1]
        known = around[around > 0].astype(float)
        shared = np.mean(np.abs(1 / known - 1 / depth) <= COHERENT_STEPS * views.steps[view])
        if agreeing[row, column] < CONFIRMED and shared < 0.5:
            contradicting[row, column] += 1
        footprints[row, column] = min(covered)
    return agreeing, contradicting, footprints


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("tolerance", [0.01, 0.2])
@pytest.mark.parametrize("apart", [None, 0.005, 0.0138, 0.02])
def test_comparison_is_that_of_the_twin(seed: int, tolerance: float, apart: float | None) -> None:
    """Of views from all around, and with two that are nearly the same: at a depth of 4, a baseline of 0.014 is enough.

    One of 0.0138 is enough at a depth of 3.9.
    """
    views = with_copy(random_views(seed), apart) if apart else random_views(seed)
    for view in range(3):
        found, expected = compare_depths(views, view, tolerance), twin(views, view, tolerance)
        np.testing.assert_array_equal(found[0], expected[0])
        np.testing.assert_array_equal(found[1], expected[1])
        np.testing.assert_allclose(found[2], expected[2], rtol=1e-6)
    if tolerance > 0.1 and not apart:
        assert all(twin(views, view, tolerance)[part].any() for view in range(3) for part in range(2))


def test_a_copy_of_a_photograph_confirms_nothing() -> None:
    """Two views have the same wrong depths of a wall, which nobody else sees."""
    frame = wall_frame("first", np.array([0, 0, -4.0]), 64)
    wrong = certain(np.full((64, 64), 2.0, np.float32))
    for apart, confirmed in ((0.0, False), (0.001, False), (0.02, True)):
        other = wall_frame("second", np.array([apart, 0, -4.0]), 64)
        views = views_of([frame, other], [wrong, wrong])
        assert np.all(compare_depths(views, 0, 0.01)[0][:, 1:] == confirmed)
        confidences, _ = next(CpuStereo().compare(views, [wrong.margin] * 2, 0.01, SETTINGS.confidence))
        assert np.all((confidences >= SETTINGS.confidence)[:, 1:] == confirmed)


def test_the_background_is_confirmed_by_views_that_tell_the_distance_of_the_rest() -> None:
    """A wall at 2 and, in a quarter of the view, something too far away for the baseline."""
    depth = np.full((64, 64), 2.0, np.float32)
    depth[:32, :32] = 900.0
    eyes = np.array([[0.0, 0, -2], [0.1, 0, -2]])
    frames = [wall_frame(f"{index}", eye, 64) for index, eye in enumerate(eyes)]
    agreeing, _, _ = compare_depths(views_of(frames, [certain(depth)] * 2), 0, 0.01)
    assert np.mean(agreeing[:30, 4:28]) == np.mean(agreeing[34:, 4:60]) == 1.0


def test_hundreds_of_views_are_counted() -> None:
    """One view at half the depth of 300 others, 299 of which agree with the other from beside it."""
    depths = np.full((301, 2, 2), 4.0, np.float32)
    depths[0] = 2.0
    views = SweptViews(
        depths,
        np.tile([2.0, 2.0, 1.0, 1.0], (301, 1)),
        np.full((301, 2), 2),
        np.tile(np.eye(3), (301, 1, 1)),
        np.array([[0.0, 0, 0]] * 2 + [[0.05, 0, 0]] * 299),
        np.full(301, 1e-4),
    )
    assert np.all(compare_depths(views, 0, 0.01)[1] == 300)
    assert np.all(compare_depths(views, 1, 0.01)[0] == 299)


def test_depths_that_others_contradict_are_left_out(table: Capture, exact: list[DepthMap]) -> None:
    """One view claims to see something half-way to everything; the others look through it."""
    wrong = [certain(exact[0].depth * np.float32(0.5)), *exact[1:]]
    cloud = cloud_of(table.train, wrong, table.train, 5000)
    assert np.mean(on_surface(cloud, table.train)) > 0.97


def on_surface(cloud: PointCloud, frames: list[Frame]) -> np.ndarray:
    """(N,) bool: a frame's true depth at the point is its distance to within 1 %."""
    positions = cloud.positions.astype(np.float64)
    found = np.zeros(len(cloud), bool)
    for frame in frames:
        assert frame.depth is not None
        seen, columns, rows, depth = projected(frame, positions)
        found[seen] |= np.abs(frame.depth[rows, columns] / depth - 1) < 0.01
    return found


def projected(frame: Frame, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points that a frame has in view, and their columns, rows and depths."""
    pixels, depth = frame.camera.project(positions)
    seen = (depth > 0) & np.all((pixels >= 0) & (pixels < frame.image.shape[1::-1]), axis=1)
    columns, rows = pixels[seen].astype(int).T
    return seen, columns, rows, depth[seen]


@pytest.mark.parametrize("count", [200, 1000, 6000, 30_000])
def test_exact_depths_give_nearly_the_count_and_never_more(table: Capture, exact: list[DepthMap], count: int) -> None:
    cloud = cloud_of(table.train, exact, table.train, count)
    assert 0.9 * count <= len(cloud) <= count
    assert np.isfinite(cloud.positions).all()


def test_points_lie_on_the_surface_with_its_colour(table: Capture, exact: list[DepthMap]) -> None:
    cloud = cloud_of(table.train, exact, table.train, 20_000)
    assert np.mean(on_surface(cloud, table.train)) > 0.98
    differences = []
    for frame in table.train:
        assert frame.depth is not None
        seen, columns, rows, depth = projected(frame, cloud.positions.astype(np.float64))
        visible = np.abs(frame.depth[rows, columns] / depth - 1) < 0.01
        shown = frame.image[rows, columns] / 255
        differences.append(np.abs(shown - cloud.colours[seen]).max(axis=1)[visible])
    assert np.median(np.concatenate(differences)) < 0.05


def test_directions_lead_to_the_cameras(table: Capture, exact: list[DepthMap]) -> None:
    cloud = cloud_of(table.train, exact, table.train, 3000)
    assert cloud.directions is not None
    np.testing.assert_allclose(np.linalg.norm(cloud.directions, axis=1), 1, atol=1e-5)
    offsets = np.array([frame.camera.centre for frame in table.train])[:, None] - cloud.positions
    towards = offsets / np.linalg.norm(offsets, axis=2, keepdims=True)
    # Between the directions to the cameras: no farther from any than they are from each other.
    apart = np.arccos(np.clip(np.einsum("fpx,gpx->fgp", towards, towards), -1, 1)).max(axis=(0, 1))
    off = np.arccos(np.clip(np.sum(towards * cloud.directions, axis=2), -1, 1))
    assert np.all(off.max(axis=0) < apart + np.radians(3))
    assert np.degrees(off.min(axis=0).max()) < 25


def test_points_are_denser_where_pixels_are() -> None:
    """A wall seen from far and, in its left half, from near: there it has more points."""
    far = [wall_frame(f"far{x}", np.array([x, 0, -4.0]), 64) for x in (-0.2, 0.0, 0.2)]
    near = [wall_frame(f"near{x}", np.array([-0.6 + x, 0, -1.0]), 64) for x in (-0.05, 0.0, 0.05)]
    frames = far + near
    maps = [certain(frame.depth) for frame in frames if frame.depth is not None]
    cloud = cloud_of(frames, maps, frames, 2000)
    nearest, _ = cKDTree(cloud.positions).query(cloud.positions, k=2)
    spacing = nearest[:, 1]
    left = (np.abs(cloud.positions[:, 0] + 0.6) < 0.2) & (np.abs(cloud.positions[:, 1]) < 0.2)
    right = cloud.positions[:, 0] > 0.4
    assert np.median(spacing[right]) > 2 * np.median(spacing[left])


def test_points_are_denser_where_there_is_more_to_see() -> None:
    """A wall with a pattern on its left half and with nothing on its right one, seen by all frames alike."""
    pattern = np.random.default_rng(0).integers(0, 256, (64, 32, 1), dtype=np.uint8)
    frames = []
    for x in (-0.2, 0.0, 0.2):
        frame = wall_frame(f"{x}", np.array([x, 0, -4.0]), 64)
        image = frame.image.copy()
        image[:, :32] = pattern
        frames.append(replace(frame, image=image))
    maps = [certain(frame.depth) for frame in frames if frame.depth is not None]
    cloud = cloud_of(frames, maps, frames, 1000)
    across = cloud.positions[:, 0]
    left, right = np.count_nonzero(np.abs(across + 1) < 0.5), np.count_nonzero(np.abs(across - 1) < 0.5)
    assert left > 4 * right > 0


def test_points_on_opposite_sides_stay_apart() -> None:
    """Around the origin, all merged points of a sphere lie on it: no voxel mixes two places."""
    directions = np.random.default_rng(0).normal(size=(20_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    ones = np.ones(len(directions), np.float32)
    candidates = Candidates(5 * directions, np.abs(directions), directions, 0.05 * ones, ones, ones)
    cloud = CpuMerger().merged(candidates, 2000)
    assert np.linalg.norm(cloud.positions, axis=1).min() > 4.9


def wall_frame(name: str, eye: np.ndarray, size: int) -> Frame:
    """A camera that looks along z at the wall z = 0."""
    pose = np.eye(4)
    pose[:3, 3] = -eye
    camera = Camera(size, size, float(size), float(size), size / 2, size / 2, pose)
    grey = np.full((size, size, 3), 128, np.uint8)
    return Frame(name, camera, grey, depth=np.full((size, size), -eye[2], np.float32))


def test_pixels_without_depth_take_no_place_from_others(
    table: Capture, exact: list[DepthMap], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An object on masked ground keeps all of its pixels, if they are no more than may be merged."""
    columns = np.arange(160) < 40
    maps = [certain(np.where(columns, map_.depth, 0).astype(np.float32)) for map_ in exact]
    pixels, known = (sum(map(count, (map_.depth for map_ in maps))) for count in (np.size, np.count_nonzero))
    everything = fuse(table.train, maps, table.train, SETTINGS, CpuStereo()).positions
    for most, kept in ((pixels // 2, 1), (pixels // 4, 1), (pixels // 8, 2), (known // 4, 4)):
        monkeypatch.setattr("pocketgs.prior.cloud.fuse.MAX_CANDIDATES", most)
        some = fuse(table.train, maps, table.train, SETTINGS, CpuStereo()).positions
        assert len(some) == pytest.approx(len(everything) / kept, abs=len(maps))
        assert kept > 1 or np.array_equal(some, everything)


def test_no_depths_give_no_points(table: Capture, exact: list[DepthMap]) -> None:
    unknown = [certain(np.zeros_like(map_.depth)) for map_ in exact]
    cloud = cloud_of(table.train, unknown, table.train, 100)
    assert len(cloud) == 0
    assert cloud.directions is not None
    assert cloud.directions.shape == (0, 3)


def test_one_keyframe_gives_none_but_its_own_points(table: Capture, exact: list[DepthMap]) -> None:
    """Nothing confirms them, and nothing speaks against them."""
    cloud = cloud_of(table.train[:1], exact[:1], table.train, 5000)
    assert len(cloud) <= 5000
    assert np.count_nonzero(~on_surface(cloud, table.train[:1])) <= 0.03 * len(cloud)


def test_an_unclear_margin_keeps_a_depth_out(table: Capture, exact: list[DepthMap]) -> None:
    unclear = [replace(map_, margin=np.zeros_like(map_.margin)) for map_ in exact]
    assert len(cloud_of(table.train, unclear, table.train, 100)) == 0


def test_maps_of_different_sizes(table: Capture, exact: list[DepthMap]) -> None:
    frames, maps = list(table.train), list(exact)
    # Every second pixel of every second view.
    for index in range(0, len(frames), 2):
        camera = frames[index].camera.resized(80, 60)
        frames[index] = replace(frames[index], camera=camera, image=frames[index].image[::2, ::2], depth=None)
        maps[index] = certain(np.ascontiguousarray(exact[index].depth[::2, ::2]))
    cloud = cloud_of(frames, maps, table.train, 3000)
    assert 0.9 * 3000 <= len(cloud) <= 3000
    assert np.mean(on_surface(cloud, table.train)) > 0.95


def test_alpha_of_any_training_frame_bounds_the_cloud(table: Capture, exact: list[DepthMap]) -> None:
    """Also of a frame that is not a keyframe."""
    left = np.tile(np.where(np.arange(160) < 80, 255, 0).astype(np.uint8), (120, 1))
    judge = replace(table.train[3], alpha=left)
    others = [index for index in range(len(table.train)) if index != 3]
    keyframes, maps = [table.train[index] for index in others], [exact[index] for index in others]
    cloud = cloud_of(keyframes, maps, [*keyframes, judge], 2000)
    assert len(cloud) > 1500
    _, columns, _, _ = projected(judge, cloud.positions.astype(np.float64))
    assert len(columns) > 500
    # Points are means of several: those on a border may lie a little off.
    assert np.mean(columns <= 81) > 0.99


@pytest.mark.parametrize("step", [0.05, 0.001])
def test_what_is_too_far_to_tell_lies_on_one_sphere(step: float) -> None:
    """Three cameras see the same distant stars, each at another depth that it cannot tell from infinity."""
    eyes = np.array([[-1.0, 0, 0], [0, 0.3, 0], [1.0, 0, 0.2]])
    frames = [wall_frame(f"{index}", eye, 64) for index, eye in enumerate(eyes)]
    resolved = 1 / step
    maps = [certain(np.full((64, 64), resolved * far, np.float32), step) for far in (1.5, 3.0, 40.0)]
    maps[0].depth[:32] = 0.05 * resolved  # what can be told stays where it is
    found = fuse(frames, maps, frames, SETTINGS, CpuStereo())
    far = np.abs(found.positions[:, 2] - 0.05 * resolved) > 0.04 * resolved
    assert np.count_nonzero(far) > 2.4 * 64 * 64
    middle = eyes.mean(axis=0)
    radius = max(resolved, SHELL_EXTENT * np.linalg.norm(eyes - middle, axis=1).max())
    np.testing.assert_allclose(np.linalg.norm(found.positions[far] - middle, axis=1), radius, rtol=1e-6)
    for frame in frames:
        away = frame.camera.centre - found.positions[far]
        own = np.linalg.norm(np.cross(away, found.directions[far]), axis=1) < 1e-6 * radius
        assert np.count_nonzero(own) > 0.9 * 32 * 64
        pixels, depth = frame.camera.project(found.positions[far][own])
        # They are seen where they were found: in the middles of pixels, in front of the camera.
        np.testing.assert_allclose(pixels % 1, 0.5, atol=1e-3)
        np.testing.assert_allclose(found.footprints[far][own], depth / frame.camera.fx, rtol=1e-6)
        assert np.all(depth > 0)


def test_stars_that_three_views_see_are_at_the_same_pixels_of_all() -> None:
    """A star in the same direction for all cameras lies within a pixel of that direction for each of them."""
    eyes = np.array([[-1.0, 0, 0], [0, 0.3, 0], [1.0, 0, 0.2]])
    frames = [wall_frame(f"{index}", eye, 64) for index, eye in enumerate(eyes)]
    step = 1 / (64 * 3.0)  # a pixel's shift over the widest baseline
    maps = [certain(np.full((64, 64), far / step, np.float32), step) for far in (1.2, 3.0, 40.0)]
    found = fuse(frames, maps, frames, SETTINGS, CpuStereo())
    for frame in frames:
        pixels, depth = frame.camera.project(found.positions)
        assert np.all(depth > 0)
        # The cameras look along z: a direction's pixel is the same in all.
        directions = -found.directions / -found.directions[:, 2:]
        expected = 64 * directions[:, :2] + 32
        assert np.abs(pixels - expected).max() < 1.0


def test_all_cameras_are_well_inside_the_sphere_of_what_is_too_far_to_tell() -> None:
    """Also where depths are so coarse that little can be told apart."""
    eyes = np.array([[-1.0, 0, 0], [0, 0.3, 0], [1.0, 0, 0.2]])
    frames = [wall_frame(f"{index}", eye, 64) for index, eye in enumerate(eyes)]
    maps = [certain(np.full((64, 64), depth, np.float32), 2.0) for depth in (0.6, 0.9, 20.0)]
    found = fuse(frames, maps, frames, SETTINGS, CpuStereo())
    middle = eyes.mean(axis=0)
    radius = SHELL_EXTENT * np.linalg.norm(eyes - middle, axis=1).max()
    assert len(found.positions) > 64 * 64
    np.testing.assert_allclose(np.linalg.norm(found.positions - middle, axis=1), radius, rtol=1e-6)
