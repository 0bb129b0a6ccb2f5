"""Completion: points for uncovered surfaces, at plausible depths, and not too many."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pocketgs.capture.capture import Frame
from pocketgs.capture.even_choice import evenly_chosen
from pocketgs.geometry.camera import Camera, look_at
from pocketgs.prior.cloud import complete
from pocketgs.prior.cloud.complete import GUESSED_CONFIDENCE, MAX_ADDED_SHARE, completion, joined
from pocketgs.prior.cloud.coverage import ViewCells, point_radii
from pocketgs.scene.point_cloud import PointCloud

DISTANCE = 7.0
SIZE = 96


def frame(x: float = 0.0, turned: bool = False) -> Frame:
    """A view along z, as wide as it is far, red on its left and blue on its right half; or the other way round."""
    eye = np.array([x, 0, -4.0])
    pose = look_at(eye, eye + np.array([0, 0, -1.0 if turned else 1.0]), np.array([0, -1.0, 0]))
    image = np.zeros((SIZE, SIZE, 3), np.uint8)
    image[:, : SIZE // 2, 0] = image[:, SIZE // 2 :, 2] = 200
    return Frame(f"{x}{turned}", Camera(SIZE, SIZE, float(SIZE), float(SIZE), SIZE / 2, SIZE / 2, pose), image)


def wall(side: int = 150, slope: float = 0.0) -> PointCloud:
    """A grid that fills a view from a distance of 4, and more, on the plane z = slope · x."""
    x, y = np.meshgrid(*2 * [np.linspace(-2.6, 2.6, side)])
    positions = np.column_stack([x.ravel(), y.ravel(), slope * x.ravel()])
    return PointCloud(positions, np.full_like(positions, 0.5), np.tile([0, 0, -1.0], (len(positions), 1)))


def with_hole(cloud: PointCloud) -> PointCloud:
    return cloud.select(np.abs(cloud.positions[:, :2]).max(axis=1) > 0.5)


NOTHING = PointCloud(np.zeros((0, 3)), np.zeros((0, 3)))


@pytest.mark.parametrize("slope", [0.0, 0.3])
def test_holes_get_points_at_the_depth_of_their_surroundings(slope: float) -> None:
    cloud = with_hole(wall(slope=slope))
    found = completion(cloud, [frame()], [], DISTANCE, 100_000)
    assert found.known == pytest.approx(1 - (1.0 / 4.0) ** 2, abs=0.03)
    assert found.covered == 1.0
    assert found.guessed == len(found.added) == pytest.approx((1 - found.known) * SIZE**2, abs=1)
    assert np.abs(found.added.positions[:, :2]).max() < 0.56
    np.testing.assert_allclose(found.added.positions[:, 2], slope * found.added.positions[:, 0], atol=0.06)
    assert found.added.confidences is not None
    np.testing.assert_allclose(found.added.confidences, GUESSED_CONFIDENCE)
    # With the colours of the photograph, and the side that they are seen from.
    left = found.added.positions[:, 0] < 0
    np.testing.assert_allclose(found.added.colours[left], np.tile([200 / 255, 0, 0], (left.sum(), 1)), atol=1e-6)
    np.testing.assert_allclose(found.added.colours[~left], np.tile([0, 0, 200 / 255], ((~left).sum(), 1)), atol=1e-6)
    assert found.added.directions is not None
    towards = frame().camera.centre - found.added.positions
    np.testing.assert_allclose(
        np.sum(found.added.directions * towards, axis=1), np.linalg.norm(towards, axis=1), rtol=1e-5
    )


def test_a_hole_between_near_and_far_is_between_them() -> None:
    cloud = wall()
    positions = cloud.positions.copy()
    positions[positions[:, 0] > 0] *= 2.0
    positions[positions[:, 0] > 0, 2] += 4.0  # the camera is at z = -4: twice as far, at the same pixels
    cloud = replace(cloud, positions=positions)
    hole = np.abs(cloud.positions[:, 0] / (cloud.positions[:, 2] + 4)) < 0.12
    found = completion(cloud.select(~hole), [frame()], [], DISTANCE, 100_000)
    assert found.covered == 1.0
    depths = found.added.positions[:, 2] + 4
    assert 3.9 < depths.min() < 4.8
    assert 6.5 < depths.max() < 8.1


def test_other_views_see_what_was_guessed_for_one() -> None:
    """One hole that two views see is filled once."""
    one = completion(with_hole(wall()), [frame()], [], DISTANCE, 100_000)
    two = completion(with_hole(wall()), [frame(), frame(0.2)], [], DISTANCE, 100_000)
    assert two.covered == 1.0
    assert two.guessed < 1.3 * one.guessed


def test_nothing_is_added_where_all_is_known() -> None:
    found = completion(wall(), [frame(), frame(0.3)], [wall(40)], DISTANCE, 100_000)
    assert (found.known, found.covered, found.guessed, len(found.added)) == (1.0, 1.0, 0, 0)


@pytest.mark.parametrize(("hidden", "is_used"), [(1, True), (2, False)])
def test_points_are_used_where_most_views_that_show_them_are_bare(hidden: int, is_used: bool) -> None:
    """Of three views that show a hole, so many see something in front of it."""
    x, y = np.meshgrid(np.linspace(-0.4, 0.4, 60), np.linspace(-0.4, 0.4, 60))
    screens = [np.column_stack([x.ravel() + side, y.ravel(), np.full(x.size, -2.0)]) for side in (0.75, -0.75)[:hidden]]
    screen = PointCloud(np.concatenate(screens), np.zeros((hidden * x.size, 3)))
    cloud = joined([replace(with_hole(wall()), directions=None), screen])
    middle = wall(400).select(np.abs(wall(400).positions[:, :2]).max(axis=1) < 0.1)
    found = completion(cloud, [frame(1.5), frame(-1.5), frame()], [middle], DISTANCE, 100_000)
    assert len(found.added) - found.guessed == (len(middle) if is_used else 0)


def test_other_sources_fill_only_what_is_bare() -> None:
    """From a source that covers the whole wall, the points in the hole; from the next, what is still missing."""
    cloud = with_hole(wall())
    own = wall(400)
    left = own.select(own.positions[:, 0] < 0.1)
    left = replace(left, positions=left.positions + np.float32([0, 0, 0.01]))
    found = completion(cloud, [frame()], [left, own], DISTANCE, 100_000)
    assert (found.known, found.covered, found.guessed) == (1.0, 1.0, 0)
    added = found.added.positions
    assert np.abs(added[:, :2]).max() < 0.56
    first = added[:, 2] > 0.005
    assert np.count_nonzero(first) > 500
    assert np.count_nonzero(~first) > 300
    assert added[first, 0].max() < 0.1 + 1e-6
    assert added[~first, 0].min() > 0.05
    # They are believed, having been measured.
    assert found.added.confidences is not None
    np.testing.assert_array_equal(found.added.confidences, 1)


def test_of_large_sources_some_points_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same as of a source that has only those; and none is left out of one that is small enough."""
    large, cloud = wall(200), with_hole(wall())
    some = large.select(evenly_chosen(len(large), 3000))
    expected = completion(cloud, [frame()], [some], DISTANCE, 100_000).added
    whole = completion(cloud, [frame()], [large], DISTANCE, 100_000).added
    assert len(whole) > len(expected) + 500
    monkeypatch.setattr(complete, "MAX_SOURCE", 3000)
    for source in (large, some):
        found = completion(cloud, [frame()], [source], DISTANCE, 100_000).added
        np.testing.assert_array_equal(found.positions, expected.positions)


def test_sources_that_are_seen_from_the_other_side_do_not_fill() -> None:
    """They are used, since there is nothing else, but what they do not cover is guessed."""
    behind = wall(60)
    behind = replace(behind, directions=-behind.directions)  # type: ignore[operator]
    found = completion(with_hole(wall()), [frame()], [behind], DISTANCE, 100_000)
    assert found.known < 0.97
    assert found.guessed > 300
    assert found.covered == 1.0


@pytest.mark.parametrize("cloud_size", [0, 3000, 10_000])
@pytest.mark.parametrize("count", [50, 3000, 12_000])
def test_never_more_points_than_there_may_be(cloud_size: int, count: int) -> None:
    """Added points fit beside the cloud, or into the share of it that may be dropped."""
    rng = np.random.default_rng(0)
    whole = with_hole(wall())
    cloud = whole.select(np.sort(rng.permutation(len(whole))[: min(cloud_size, count)]))
    sources = [wall(70), wall(90)]
    found = completion(cloud, [frame(), frame(turned=True)], sources, DISTANCE, count)
    assert len(found.added) <= max(count - len(cloud), int(MAX_ADDED_SHARE * count))
    assert 0 <= found.guessed <= len(found.added)


@pytest.mark.parametrize("count", [5, 40, 400])
def test_points_that_there_is_no_room_for_cover_nothing(count: int) -> None:
    """The share is that of the points which are really added."""
    found = completion(NOTHING, [frame()], [], DISTANCE, count)
    assert len(found.added) == found.guessed == count
    views = ViewCells.of([frame()])
    depths = views.empty()
    views.cover(depths, found.added, point_radii(found.added.positions))
    assert found.known == 0.0
    assert found.covered == views.share(depths)
    assert 0 < found.covered < 1.0 or count > 100


def test_views_that_see_nothing_known_get_points_at_the_typical_distance() -> None:
    found = completion(wall(), [frame(), frame(turned=True)], [], DISTANCE, 100_000)
    assert found.known == 0.5
    assert found.covered == 1.0
    assert found.guessed == SIZE**2
    np.testing.assert_allclose(found.added.positions[:, 2], -4 - DISTANCE, rtol=1e-5)


def test_masked_parts_get_no_points() -> None:
    masked = replace(frame(), mask=np.tile(np.arange(SIZE) < SIZE // 2, (SIZE, 1)))
    found = completion(with_hole(wall()), [masked], [], DISTANCE, 100_000)
    assert found.covered == 1.0
    assert found.guessed > 200
    assert found.added.positions[:, 0].max() <= 0


def test_scale_does_not_matter() -> None:
    def scaled(scale: float) -> tuple[float, float, int]:
        pose = frame().camera.world_to_camera.copy()
        pose[:3, 3] *= scale
        view = replace(frame(), camera=replace(frame().camera, world_to_camera=pose))
        cloud = with_hole(wall())
        cloud = replace(cloud, positions=cloud.positions * np.float32(scale))
        found = completion(cloud, [view], [], DISTANCE * scale, 100_000)
        return found.known, found.covered, found.guessed

    assert scaled(1e-4)[2] == pytest.approx(scaled(1.0)[2], rel=0.01)
    assert scaled(1e4)[2] == pytest.approx(scaled(1.0)[2], rel=0.01)


def test_joined_clouds() -> None:
    plain = PointCloud(np.ones((2, 3)), np.zeros((2, 3)))
    known = PointCloud(np.zeros((1, 3)), np.ones((1, 3)), np.array([[0, 0, 1.0]]), np.array([0.3]))
    both = joined([plain, known])
    np.testing.assert_array_equal(both.positions, [[1, 1, 1], [1, 1, 1], [0, 0, 0]])
    np.testing.assert_array_equal(both.directions, [[0, 0, 0], [0, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(both.confidences, [1, 1, 0.3], rtol=1e-6)
    assert len(joined([])) == 0
    assert joined([]).directions is not None
