"""Coverage of views by a cloud, against a computation cell by cell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pocketgs.capture.capture import Frame
from pocketgs.geometry.camera import Camera, look_at
from pocketgs.prior.cloud.coverage import CELLS, LARGEST, WIDEST_COVERED_ANGLE, ViewCells, point_radii
from pocketgs.scene.point_cloud import PointCloud

TOWARDS = np.array([0.0, 0.0, -1.0])


def frame(eye: tuple[float, float, float], target: tuple[float, float, float] = (0, 0, 0), size: int = 96) -> Frame:
    """A square view, as wide as it is far."""
    pose = look_at(np.array(eye), np.array(target), np.array([0, -1.0, 0]))
    camera = Camera(size, size, float(size), float(size), size / 2, size / 2, pose)
    return Frame(str(eye), camera, np.full((size, size, 3), 90, np.uint8))


def sized(width: int, height: int, eye: tuple[float, float, float] = (0, 0, -4)) -> Frame:
    focal = 0.9 * width
    camera = Camera(width, height, focal, 1.1 * focal, 0.45 * width, 0.6 * height, frame(eye).camera.world_to_camera)
    return Frame(f"{width}x{height}", camera, np.full((height, width, 3), 90, np.uint8))


def wall(side: int = 150, directions: bool = True) -> PointCloud:
    """A grid on z = 0 that fills a view from a distance of 4, seen from where z is negative."""
    x, y = np.meshgrid(*2 * [np.linspace(-2.2, 2.2, side)])
    positions = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    seen_from = np.tile(TOWARDS, (len(positions), 1)) if directions else None
    return PointCloud(positions, np.full_like(positions, 0.5), seen_from)


def covered(frames: list[Frame], points: PointCloud, radii: np.ndarray | None = None) -> tuple[ViewCells, np.ndarray]:
    views = ViewCells.of(frames)
    depths = views.empty()
    views.cover(depths, points, point_radii(points.positions) if radii is None else radii)
    return views, depths


def twin(frames: list[Frame], points: PointCloud, radii: np.ndarray) -> list[np.ndarray]:
    """Nearest depth of every cell, one view, one point and one cell at a time."""
    found = []
    for one in frames:
        camera = one.camera
        side = max(camera.width, camera.height) / CELLS
        rows, columns = max(1, round(camera.height / side)), max(1, round(camera.width / side))
        depths = np.full((rows, columns), np.inf)
        (pixels, distances) = camera.project(points.positions.astype(np.float64))
        for index, ((x, y), depth) in enumerate(zip(pixels, distances, strict=True)):
            if depth <= 0:
                continue
            if points.directions is not None:
                towards = camera.centre - points.positions[index]
                direction = points.directions[index].astype(np.float64)
                if direction.any() and direction @ towards < np.cos(WIDEST_COVERED_ANGLE) * np.linalg.norm(towards):
                    continue
            column, row = x * columns / camera.width, y * rows / camera.height
            reach = 0.5 + min(LARGEST, radii[index] * camera.fx * columns / camera.width / depth)
            for cell in np.ndindex(rows, columns):
                if abs(cell[0] + 0.5 - row) <= reach and abs(cell[1] + 0.5 - column) <= reach:
                    depths[cell] = min(depths[cell], depth)
        found.append(depths)
    return found


@pytest.mark.parametrize("directions", [True, False])
def test_coverage_is_that_of_the_twin(directions: bool) -> None:
    """Points around and behind cameras of several sizes and shapes."""
    rng = np.random.default_rng(3)
    frames = [sized(60, 40), sized(30, 90, (1, 0.5, -3)), frame((0, 0, 4), size=33), sized(400, 20, (-2, 0, -2))]
    normals = rng.normal(size=(40, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[:5] = 0
    points = PointCloud(rng.normal(0, 1.5, (40, 3)), rng.random((40, 3)), normals if directions else None)
    radii = rng.exponential(0.1, 40) * (rng.random(40) > 0.2)
    views, depths = covered(frames, points, radii)
    expected = twin(frames, points, radii)
    assert 0.01 < np.mean([np.isfinite(of_view).mean() for of_view in expected]) < 0.9
    for of_view, (rows, columns), cells in zip(expected, views.sizes, depths, strict=True):
        assert (rows, columns) == of_view.shape
        np.testing.assert_allclose(cells[:rows, :columns], of_view, rtol=1e-5)
    whole = np.concatenate([of_view.ravel() for of_view in expected])
    assert views.share(depths) == pytest.approx(np.isfinite(whole).mean())


def test_a_wall_covers_the_views_of_its_own_side() -> None:
    before, behind = frame((0, 0, -4)), frame((0, 0, 4))
    for frames, share in (([before], 1.0), ([behind], 0.0), ([before, behind], 0.5)):
        views, depths = covered(frames, wall())
        assert views.share(depths) == share
    # Points that nobody knows the side of cover both.
    views, depths = covered([before, behind], wall(directions=False))
    assert views.share(depths) == 1.0


@pytest.mark.parametrize(("degrees", "share"), [(60, 1.0), (85, 0.0)])
def test_a_grazing_view_is_not_covered(degrees: float, share: float) -> None:
    """The middle of a wall, from a direction further and further away from that it was seen from."""
    angle = np.radians(degrees)
    view = frame((4 * np.sin(angle), 0, -4 * np.cos(angle)))
    middle = wall().select(np.hypot(*wall().positions[:, :2].T) < 0.1)
    _, depths = covered([view], middle)
    assert np.isfinite(depths[0, 47:49, 47:49]).mean() == share


def test_the_share_is_that_of_the_part_that_points_lie_in() -> None:
    points = wall()
    left = points.select(points.positions[:, 0] < 0)
    views, depths = covered([frame((0, 0, -4))], left)
    assert views.share(depths) == pytest.approx(0.5, abs=1.5 / CELLS)


def test_a_lonely_point_explains_little() -> None:
    """However far its neighbours are."""
    points = PointCloud(np.array([[0, 0, 0], [50, 0, 0], [0, 50, 0], [0, 0, 50.0]]), np.zeros((4, 3)))
    views, depths = covered([frame((0, 0, -4))], points)
    assert 0 < views.share(depths) <= ((2 * LARGEST + 2) / CELLS) ** 2


def test_sparse_points_cover_what_lies_between_them() -> None:
    """As much as dense ones: they become larger Gaussians."""
    views, depths = covered([frame((0, 0, -4))], wall(side=30))
    assert views.share(depths) > 0.99


def test_nearer_points_hide_farther_ones() -> None:
    near = wall()
    far = replace(near, positions=near.positions * np.float32(7 / 4) + np.float32([0, 0, 3]))
    views, depths = covered([frame((0, 0, -4))], far)
    np.testing.assert_allclose(depths, 7, rtol=1e-6)
    views.cover(depths, near, point_radii(near.positions))
    np.testing.assert_allclose(depths, 4, rtol=1e-6)
    views.cover(depths, far, point_radii(far.positions))
    np.testing.assert_allclose(depths, 4, rtol=1e-6)


def test_masked_cells_do_not_count() -> None:
    view = frame((0, 0, -4))
    points = wall()
    left = points.select(points.positions[:, 0] < -0.2)
    mask = np.tile(np.arange(96) >= 48, (96, 1))
    for used, share in ((~mask, 0.9), (mask, 0.0)):
        views, depths = covered([replace(view, mask=used)], left)
        assert views.share(depths) == pytest.approx(share, abs=0.03)
    views, depths = covered([replace(view, mask=np.zeros((96, 96), bool))], left)
    assert views.share(depths) == 0.0
    alpha = np.where(mask, 0, 255).astype(np.uint8)
    np.testing.assert_array_equal(ViewCells.of([replace(view, alpha=alpha)]).usable[0], ~mask)


def test_views_of_other_sizes_are_padded_and_padding_does_not_count() -> None:
    frames = [frame((0, 0, -4)), sized(200, 50), sized(25, 100)]
    views, depths = covered(frames, wall())
    assert [tuple(size) for size in views.sizes] == [(96, 96), (24, 96), (96, 24)]
    assert views.usable.shape == depths.shape == (3, 96, 96)
    assert [int(np.count_nonzero(usable)) for usable in views.usable] == [96 * 96, 24 * 96, 96 * 24]
    assert not views.usable[1, 24:].any()
    assert not views.usable[2, :, 24:].any()
    assert not np.isfinite(depths[1, 24:]).any()
    assert not np.isfinite(depths[2, :, 24:]).any()


def test_uncovered_share() -> None:
    """Of two views that see a point, one is covered there; the point is behind a third."""
    frames = [frame((0, 0, -4)), frame((0, 0, 4)), frame((0, 0, -1), target=(0, 0, -2))]
    views, depths = covered(frames, wall())
    masked = [*frames[:1], replace(frames[1], mask=np.zeros((96, 96), bool)), frames[2]]
    spots = np.array([[0, 0, 0.0], [0.5, 0.5, 0], [0, 0, -50], [0, 90, 0]])
    np.testing.assert_allclose(views.uncovered_share(depths, spots), [0.5, 0.5, 1, 0])
    views, depths = covered(masked, wall())
    np.testing.assert_allclose(views.uncovered_share(depths, spots), [0, 0, 1, 0])
    np.testing.assert_allclose(views.uncovered_share(views.empty(), spots), [1, 1, 1, 0])
    assert len(views.uncovered_share(depths, np.zeros((0, 3)))) == 0


def test_uncovered_shares_are_those_of_the_cells_that_show_a_position() -> None:
    rng = np.random.default_rng(0)
    frames = [frame((0, 0, -4)), frame((3, 0, 2)), frame((-1, 2, 4)), sized(200, 50)]
    views, depths = covered([replace(frames[0], mask=rng.random((96, 96)) < 0.7), *frames[1:]], wall(20))
    spots = np.concatenate([rng.uniform(-3, 3, (5000, 3)), np.full((1, 3), np.nan)])
    shown, bare = np.zeros((2, len(spots)))
    for view in range(len(frames)):
        inside, cells, _ = views.cells_of(view, spots)
        shown[inside] += views.usable[view][cells]
        bare[inside] += views.usable[view][cells] & ~np.isfinite(depths[view][cells])
    np.testing.assert_array_equal(views.uncovered_share(depths, spots), bare / np.maximum(shown, 1))
    assert 0 < np.count_nonzero(bare) < np.count_nonzero(shown)


def test_radii_are_spacings() -> None:
    np.testing.assert_allclose(np.median(point_radii(wall(20).positions)), 4.4 / 19, rtol=1e-3)
    assert point_radii(np.zeros((3, 3))).tolist() == [0, 0, 0]
    assert len(point_radii(np.zeros((0, 3)))) == 0


def test_no_points_cover_nothing() -> None:
    views, depths = covered([frame((0, 0, -4))], PointCloud(np.zeros((0, 3)), np.zeros((0, 3))))
    assert views.share(depths) == 0.0
