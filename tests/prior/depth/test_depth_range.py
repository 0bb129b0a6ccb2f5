"""Depth ranges contain near, far and infinitely far surfaces, and are fine enough."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pocketgs.capture.capture import Frame
from pocketgs.geometry.camera import Camera
from pocketgs.prior.depth.cpu.stereo import CpuStereo
from pocketgs.prior.depth.depth_maps import MAX_SWEPT_PIXELS, depth_maps, sweep_pixels
from pocketgs.prior.depth.depth_range import (
    FEWEST,
    MOST,
    PIXELS_PER_STEP,
    WIDE_PIXELS,
    DepthRange,
    depths_of,
    narrowed,
    small_copy,
    wide_range,
)
from pocketgs.prior.depth.sweep import MAX_PIXELS, DepthMap, SweepSettings

DISTANCE = 4.0
NEAR = 1.5
WIDTH, HEIGHT, FOCAL = 160, 120, 150.0


def frame(x: float = 0.0, width: int = WIDTH) -> Frame:
    pose = np.eye(4)
    pose[0, 3] = -x
    height, focal = width * HEIGHT // WIDTH, FOCAL * width / WIDTH
    camera = Camera(width, height, focal, focal, width / 2, height / 2, pose)
    return Frame(f"{x}", camera, np.zeros((height, width, 3), np.uint8))


def points_at(*depths: float) -> np.ndarray:
    """Thirty points before `frame()` at each depth."""
    rng = np.random.default_rng(0)
    return np.concatenate([np.column_stack([rng.uniform(-0.2, 0.2, (30, 2)) * z, np.full(30, z)]) for z in depths])


@given(nearest=st.floats(1e-4, 1e4), times=st.floats(1.5, 1e3), hypotheses=st.integers(8, 192))
def test_depths_tried_reach_from_end_to_end(nearest: float, times: float, hypotheses: int) -> None:
    for farthest in (nearest * times, np.inf):
        inverse = DepthRange(nearest, farthest, hypotheses).inverse_depths
        assert (len(inverse), inverse.dtype) == (hypotheses, np.float32)
        steps = np.diff(inverse.astype(np.float64))
        np.testing.assert_allclose(steps, steps.mean(), rtol=0.01)
        assert 1 / inverse[-1] == pytest.approx(nearest, rel=1e-5)
        if np.isfinite(farthest):
            assert 1 / inverse[0] == pytest.approx(farthest, rel=1e-4)
        else:
            assert inverse[0] == pytest.approx(steps.mean() / 2, rel=0.01)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_the_wide_range_holds_what_is_nearer_than_sparse_points_and_infinity(scale: float) -> None:
    found = wide_range(frame(), scale * points_at(2.0, 5.0, 30.0), 7.0 * scale)
    assert found.farthest == np.inf
    assert 0.3 * scale < found.nearest < scale
    unknown = wide_range(frame(), np.zeros((0, 3)), DISTANCE * scale)
    assert unknown.farthest == np.inf
    assert 0.25 * scale < unknown.nearest < 0.25 * DISTANCE * scale
    # Points behind the camera tell nothing.
    assert wide_range(frame(), -scale * points_at(2.0), DISTANCE * scale) == unknown


@pytest.mark.parametrize(("near", "far"), [(1.0, 1.2), (1.0, 4.0), (2.0, 40.0), (0.8, 400.0)])
def test_near_and_far_are_both_within_the_narrowed_range(near: float, far: float) -> None:
    wide = DepthRange(0.5, np.inf, 64)
    few = np.array([near] * 3 + [far] * 200 + [0.5 * (near + far)] * 50)
    for found in (few, np.array([near] * 200 + [far] * 3), np.array([near] * 100 + [far] * 100)):
        narrow = narrowed(wide, found, frame(), [frame(0.3)])
        assert wide.nearest * (1 - 1e-5) <= narrow.nearest <= near
        assert narrow.farthest >= far
        if far < 1 / (3 * np.diff(wide.inverse_depths[:2])[0]):
            assert np.isfinite(narrow.farthest)
            # One depth does not widen the range by much.
            assert 1 / narrow.nearest - 1 / narrow.farthest < 1 / near - 1 / far + 4 / 64 / 0.5


def test_what_is_infinitely_far_keeps_the_range_infinite() -> None:
    wide = DepthRange(0.5, np.inf, 64)
    sky = np.full(50, 1 / wide.inverse_depths[0])
    narrow = narrowed(wide, np.concatenate([np.full(200, 2.0), sky]), frame(), [frame(0.3)])
    assert narrow.farthest == np.inf
    assert 1.5 < narrow.nearest < 2.0


def test_a_few_wrong_depths_do_not_widen_the_range() -> None:
    wide = DepthRange(0.1, np.inf, 64)
    found = np.concatenate([np.linspace(2, 4, 1000), [0.12, 0.13, 1e3]])
    narrow = narrowed(wide, found, frame(), [frame(0.3)])
    clean = narrowed(wide, found[:1000], frame(), [frame(0.3)])
    assert narrow.nearest == pytest.approx(clean.nearest, rel=0.05)


def test_where_hardly_anything_was_found_the_range_stays_wide() -> None:
    wide = DepthRange(0.5, np.inf, 64)
    narrow = narrowed(wide, np.full(5, 2.0), frame(), [frame(0.3)])
    assert (narrow.nearest, narrow.farthest) == (pytest.approx(0.5), np.inf)


@pytest.mark.parametrize("baseline", [0.01, 0.3, 0.8, 5.0])
def test_hypotheses_are_as_fine_as_the_widest_baseline_tells_apart(baseline: float) -> None:
    wide, depths = DepthRange(0.5, np.inf, 64), np.linspace(1.5, 8, 300)
    narrow = narrowed(wide, depths, frame(), [frame(baseline / 3), frame(-baseline)])
    shift = (1 / narrow.nearest - 1 / narrow.farthest) * baseline * FOCAL
    assert narrow.hypotheses == np.clip(np.ceil(shift / PIXELS_PER_STEP), FEWEST, MOST)
    assert narrowed(wide, depths, frame(), []).hypotheses == FEWEST


def test_small_copies_see_the_same() -> None:
    large = frame(width=800)
    small = small_copy(large)
    pixels = small.camera.width * small.camera.height
    assert 0.9 * WIDE_PIXELS < pixels <= WIDE_PIXELS
    assert small.camera.fx / small.camera.width == pytest.approx(large.camera.fx / large.camera.width)
    assert small_copy(frame(width=80)).camera.width == 80


def test_depths_of_points() -> None:
    np.testing.assert_allclose(depths_of(frame(), np.array([[0, 0, 2.0], [1, 1, -3], [5, 0, 4]])), [2, 4])
    assert len(depths_of(frame(), np.zeros((0, 3)))) == 0


def test_more_keyframes_are_searched_at_a_smaller_size() -> None:
    assert sweep_pixels(1) == sweep_pixels(2) == MAX_PIXELS
    for keyframes in (50, 100, 300):
        assert 0.9 * MAX_SWEPT_PIXELS < keyframes * sweep_pixels(keyframes) <= MAX_SWEPT_PIXELS
    assert sweep_pixels(0) == MAX_PIXELS


TEXTURE = cv2.GaussianBlur(np.random.default_rng(3).random((768, 768), np.float32), (0, 0), 1.5)
TEXTURE = np.float32(255) * (TEXTURE - TEXTURE.min()) / (TEXTURE.max() - TEXTURE.min())


SKY = 1e9
"""A depth that is practically infinite."""


def three_layers(x: float) -> Frame:
    """Bars near the camera, a wall, and far behind it, in the upper third, a sky: `NEAR`, 4 and infinitely far away."""
    seen = frame(x)
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float32) + np.float32(0.5)
    depth = np.where(rows < HEIGHT / 3, SKY, 4.0)
    across = (columns - WIDTH / 2) / np.float32(FOCAL)
    bar = np.abs(across * NEAR + x) < 0.18
    depth = np.where(bar & (rows > HEIGHT / 2), NEAR, depth)
    layer = np.select([depth == NEAR, depth == 4.0], [400, 200], 0)
    shift = FOCAL * x / depth
    where_x, where_y = (columns + shift + 250).astype(np.float32), (rows + layer).astype(np.float32)
    grey = cv2.remap(TEXTURE, where_x, where_y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_WRAP)
    image = np.repeat(np.clip(np.round(grey), 0, 255).astype(np.uint8)[:, :, None], 3, axis=2)
    return replace(seen, image=image, depth=depth.astype(np.float32))


@pytest.mark.parametrize("know_points", [True, False])
def test_depth_maps_tell_near_wall_and_sky(know_points: bool) -> None:
    """Sparse points are on the wall only, or missing: nearer and farther surfaces are found all the same."""
    frames = [three_layers(x) for x in (-0.5, -0.25, 0.0, 0.25, 0.5)]
    bare = [replace(one, depth=None) for one in frames]
    points = [points_at(4.0) if know_points else np.zeros((0, 3))]
    (keyframe,), (found,) = depth_maps(bare[2:3], bare, points, DISTANCE, SweepSettings(), CpuStereo())
    assert isinstance(found, DepthMap)
    assert keyframe.name == bare[2].name
    depth = frames[2].depth
    assert depth is not None
    inner = np.zeros(depth.shape, bool)
    inner[6:-6, 10:-10] = True
    same = cv2.erode((depth == cv2.erode(depth, np.ones((9, 9)))).astype(np.uint8), np.ones((9, 9))) > 0
    for true_depth in (NEAR, 4.0, SKY):
        where = (depth == true_depth) & same & inner
        assert np.count_nonzero(where) > 300
        if true_depth < SKY:
            assert np.mean(np.abs(found.depth[where] / true_depth - 1) < 0.03) > 0.9
        else:
            assert np.mean(found.depth[where] > found.resolved) > 0.9
