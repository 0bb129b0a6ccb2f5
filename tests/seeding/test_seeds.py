"""Seeding: discs on the surface or balls at the points, sized by the distance to neighbours."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy.spatial.transform import Rotation

from pocketgs import Gaussians, PocketGSError, PointCloud
from pocketgs.scene.gaussians import SH_COEFFICIENTS, SH_DC
from pocketgs.seeding.neighbourhoods import MIN_POINTS
from pocketgs.seeding.seeds import SEEDINGS, Seeding, seed_balls, seed_discs

SHAPES = {"discs": np.array([1, 1, 0.3]), "balls": np.ones(3)}
NORMAL = np.array([2.0, -1.0, 2.0]) / 3


@pytest.fixture(params=list(SEEDINGS))
def seed(request: pytest.FixtureRequest) -> Seeding:
    """Each way of seeding."""
    return SEEDINGS[request.param]


def cloud(positions: np.ndarray, directions: np.ndarray | None = None) -> PointCloud:
    return PointCloud(positions, np.random.default_rng(1).uniform(size=(len(positions), 3)), directions)


def on_a_plane(count: int, noise: float) -> np.ndarray:
    """Points of a square of side 1 with the normal NORMAL, with noise along it."""
    rng = np.random.default_rng(count)
    tangents = np.linalg.svd(NORMAL[None])[2][1:]
    return np.asarray(rng.uniform(size=(count, 2)) @ tangents + rng.normal(0, noise, (count, 1)) * NORMAL)


def normals(scene: Gaussians) -> np.ndarray:
    """(N, 3) the z-axes, along which discs are thin."""
    w, x, y, z = scene.quaternions.astype(np.float64).T
    return Rotation.from_quat(np.stack([x, y, z, w], axis=1)).as_matrix()[:, :, 2]


@pytest.mark.parametrize("shape", list(SEEDINGS))
def test_scale_is_the_mean_distance_to_the_three_nearest(shape: str) -> None:
    points = cloud(np.random.default_rng(0).normal(size=(200, 3)))
    scene = SEEDINGS[shape](points, 0.1, 0, 1.0)
    positions = points.positions.astype(np.float64)
    distances = np.linalg.norm(positions[:, None] - positions, axis=2)
    expected = np.sort(distances, axis=1)[:, 1:4].mean(axis=1)
    np.testing.assert_allclose(scene.scales, expected[:, None] * SHAPES[shape], rtol=1e-5)


def test_discs_lie_on_the_surface() -> None:
    scene = seed_discs(cloud(on_a_plane(2000, noise=1e-4)), 0.1, 0)
    cosines = np.abs(normals(scene) @ NORMAL)
    assert np.mean(1 - cosines < 1e-2) == 1
    assert np.median(np.degrees(np.arccos(np.minimum(cosines, 1)))) < 1


def test_discs_of_a_ball_face_away_from_its_middle() -> None:
    outwards = np.random.default_rng(0).normal(size=(3000, 3))
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    for side in (1, -1):
        scene = seed_discs(cloud(4 + outwards, directions=side * outwards), 0.1, 0)
        assert np.median(np.sum(normals(scene) * outwards, axis=1) * side) > 0.99


def test_discs_face_where_they_were_seen_from() -> None:
    positions = on_a_plane(500, noise=0.01)
    slanted = NORMAL + np.random.default_rng(0).normal(0, 0.3, (500, 3))
    slanted *= np.where(np.arange(500) % 2, 1, -1)[:, None] / np.linalg.norm(slanted, axis=1, keepdims=True)
    scene = seed_discs(cloud(positions, directions=slanted), 0.1, 0)
    assert np.all(np.sum(normals(scene) * slanted, axis=1) >= 0)
    # What they face changes nothing else.
    unaware = seed_discs(cloud(positions), 0.1, 0)
    np.testing.assert_allclose(np.abs(np.sum(normals(scene) * normals(unaware), axis=1)), 1, atol=1e-5)
    assert scene.log_scales.tobytes() == unaware.log_scales.tobytes()


def test_balls_are_not_turned() -> None:
    scene = seed_balls(cloud(on_a_plane(20, noise=0.1)), 0.1, 0)
    np.testing.assert_array_equal(scene.quaternions, np.tile(np.float32([1, 0, 0, 0]), (20, 1)))


@pytest.mark.parametrize("count", [4, 5, 16, 17, 18])
def test_few_points_are_enough(seed: Seeding, count: int) -> None:
    scene = seed(cloud(on_a_plane(count, noise=0)), 0.1, 0, 1.0)
    assert len(scene) == count
    assert sound(scene)
    if seed is seed_discs:
        np.testing.assert_allclose(np.abs(normals(scene) @ NORMAL), 1, atol=1e-4)


def sound(scene: Gaussians) -> bool:
    """Whether a scene has finite positive scales and unit quaternions."""
    lengths = np.linalg.norm(scene.quaternions.astype(np.float64), axis=1)
    return bool(np.isfinite(scene.log_scales).all() and (scene.scales > 0).all() and np.allclose(lengths, 1, atol=1e-5))


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_the_rest(seed: Seeding, degree: int) -> None:
    points = cloud(np.random.default_rng(0).normal(size=(20, 3)))
    scene = seed(points, 0.3, degree, 1.0)
    assert scene.means.tobytes() == points.positions.astype(np.float32).tobytes()
    np.testing.assert_allclose(scene.opacities, 0.3, rtol=1e-6)
    assert scene.sh.shape == (20, SH_COEFFICIENTS[degree], 3)
    np.testing.assert_allclose(0.5 + SH_DC * scene.sh[:, 0], points.colours, atol=1e-6)
    assert not scene.sh[:, 1:].any()


@pytest.mark.parametrize("repetitions", [2, 4, 40])
def test_points_on_top_of_each_other(seed: Seeding, repetitions: int) -> None:
    """Some, or all: each has the scales and axes that it would have if it were there once."""
    apart = np.random.default_rng(0).normal(size=(50, 3))
    once = seed(cloud(apart), 0.1, 0, 1.0)
    some = np.concatenate([np.repeat(np.arange(5), repetitions), np.arange(5, 50)])
    for rows in (some, np.tile(np.arange(50), repetitions)):
        scene = seed(cloud(apart[rows]), 0.1, 0, 1.0)
        assert scene.means.tobytes() == once.means[rows].tobytes()
        np.testing.assert_array_equal(scene.log_scales, once.log_scales[rows])
        np.testing.assert_array_equal(scene.quaternions, once.quaternions[rows])


def test_points_that_nearly_coincide(seed: Seeding) -> None:
    apart = np.random.default_rng(0).normal(size=(50, 3))
    beside = apart[0] + 1e-12 * np.random.default_rng(1).normal(size=(5, 3))
    scene = seed(cloud(np.concatenate([apart, beside])), 0.1, 0, 1.0)
    assert sound(scene)
    # Small beside the others, but not without size.
    assert scene.scales.min() > 1e-3 * np.median(scene.scales)


@pytest.mark.parametrize("shape", list(SEEDINGS))
@given(positions=arrays.arrays(np.float32, (6, 3), elements=st.floats(-1e6, 1e6, width=32)))
def test_any_points_give_sound_gaussians(shape: str, positions: np.ndarray) -> None:
    if len(np.unique(positions, axis=0)) >= MIN_POINTS:
        assert sound(SEEDINGS[shape](cloud(positions), 0.1, 0, 1.0))
    else:
        with pytest.raises(PocketGSError, match="of them distinct"):
            SEEDINGS[shape](cloud(positions), 0.1, 0, 1.0)


@pytest.mark.parametrize("count", [0, 1, 3])
def test_too_few_points(seed: Seeding, count: int) -> None:
    with pytest.raises(PocketGSError, match=f"{count} points to start from, {count} of them distinct"):
        seed(cloud(np.eye(3)[:count]), 0.1, 0, 1.0)


def test_too_few_distinct_points(seed: Seeding) -> None:
    with pytest.raises(PocketGSError, match="30 points to start from, 3 of them distinct, expected at least 4"):
        seed(cloud(np.tile(np.eye(3), (10, 1))), 0.1, 0, 1.0)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_points_that_are_not_finite(seed: Seeding, value: float) -> None:
    positions = np.random.default_rng(0).normal(size=(10, 3))
    positions[3, 1] = value
    with pytest.raises(PocketGSError, match="not finite"):
        seed(cloud(positions), 0.1, 0, 1.0)


def test_size_is_a_factor(seed: Seeding) -> None:
    points = cloud(np.random.default_rng(0).normal(size=(20, 3)))
    whole, half = (seed(points, 0.1, 0, size) for size in (1.0, 0.5))
    np.testing.assert_allclose(half.scales, 0.5 * whole.scales, rtol=1e-5)
