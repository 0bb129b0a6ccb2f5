"""Seeding: a ball at every point, as wide as its neighbours are far."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from pocketgs import PocketGSError, PointCloud
from pocketgs.gaussians import SH_COEFFICIENTS, SH_DC
from pocketgs.seeding import seed_isotropic


def cloud(positions: np.ndarray) -> PointCloud:
    return PointCloud(positions, np.random.default_rng(1).uniform(size=(len(positions), 3)))


def test_scale_is_the_mean_distance_to_the_three_nearest() -> None:
    points = cloud(np.random.default_rng(0).normal(size=(200, 3)))
    scene = seed_isotropic(points, opacity=0.1, sh_degree=0)
    positions = points.positions.astype(np.float64)
    distances = np.linalg.norm(positions[:, None] - positions, axis=2)
    expected = np.sort(distances, axis=1)[:, 1:4].mean(axis=1)
    np.testing.assert_allclose(scene.scales, np.repeat(expected[:, None], 3, axis=1), rtol=1e-5)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_the_rest(degree: int) -> None:
    points = cloud(np.random.default_rng(0).normal(size=(20, 3)))
    scene = seed_isotropic(points, opacity=0.3, sh_degree=degree)
    assert scene.means.tobytes() == points.positions.tobytes()
    np.testing.assert_allclose(scene.opacities, 0.3, rtol=1e-6)
    np.testing.assert_array_equal(scene.quaternions, np.tile(np.float32([1, 0, 0, 0]), (20, 1)))
    assert scene.sh.shape == (20, SH_COEFFICIENTS[degree], 3)
    np.testing.assert_allclose(0.5 + SH_DC * scene.sh[:, 0], points.colours, atol=1e-6)
    assert not scene.sh[:, 1:].any()


def test_points_on_top_of_each_other() -> None:
    apart = np.random.default_rng(0).normal(size=(50, 3))
    scene = seed_isotropic(cloud(np.concatenate([apart, *[apart[:1]] * 5])), 0.1, 0)
    assert np.isfinite(scene.log_scales).all()
    # Small beside the others, but not without size.
    assert scene.scales.min() > 1e-3 * np.median(scene.scales)
    for positions in (np.zeros((4, 3)), np.repeat(apart, 4, axis=0)):
        assert np.isfinite(seed_isotropic(cloud(positions), 0.1, 0).log_scales).all()


@given(arrays.arrays(np.float32, (6, 3), elements=st.floats(-1e6, 1e6, width=32)))
@settings(deadline=None)
def test_any_points_give_sound_gaussians(positions: np.ndarray) -> None:
    scene = seed_isotropic(cloud(positions), 0.1, 0)
    assert np.isfinite(scene.log_scales).all()
    assert (scene.scales > 0).all()


@pytest.mark.parametrize("count", [0, 1, 3])
def test_too_few_points(count: int) -> None:
    with pytest.raises(PocketGSError, match=f"{count} points to start from, expected at least 4"):
        seed_isotropic(cloud(np.zeros((count, 3))), 0.1, 0)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_points_that_are_not_finite(value: float) -> None:
    positions = np.random.default_rng(0).normal(size=(10, 3))
    positions[3, 1] = value
    with pytest.raises(PocketGSError, match="not finite"):
        seed_isotropic(cloud(positions), 0.1, 0)


def test_size_is_a_factor() -> None:
    points = cloud(np.random.default_rng(0).normal(size=(20, 3)))
    whole, half = (seed_isotropic(points, 0.1, 0, size=size) for size in (1.0, 0.5))
    np.testing.assert_allclose(half.scales, 0.5 * whole.scales, rtol=1e-5)
