"""Importance of Gaussians."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pocketgs.compression.fine_tuning import FineTuner
from pocketgs.compression.importance import Importance, contributions, importance
from pocketgs.compression.pruning import Pruner
from pocketgs.compression.rounding import ORDER
from pocketgs.compression.views import Views, cameras_around, rendered
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.scene.formats.activations import logit_of
from pocketgs.scene.formats.pgs_coding import DEFAULT
from pocketgs.scene.formats.pgs_rounding import GROUPS, rounded
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import Engine
from pocketgs.splat.rasterizer import Rasterizer
from pocketgs.splat.rendering import BLACK


@pytest.mark.parametrize("measure", ["contribution", "distinct"])
def test_what_nobody_sees_goes_first(scene: Gaussians, views: Views, engine: Engine, measure: Importance) -> None:
    hidden = np.arange(0, len(scene), 5)
    means = scene.means.copy()
    means[hidden] += 1000.0
    moved = replace(scene, means=means)
    cameras = [frame.camera for frame in views.train]
    assert not importance(moved, cameras, Rasterizer(), measure)[hidden].any()
    pruner = Pruner(FineTuner(engine, views.train, views.background, scene, 0), cameras, measure, Rasterizer())
    kept = pruner.down_to(moved, len(scene) - len(hidden))
    assert np.abs(kept.means).max() < 500.0


FACING = Camera(64, 64, 64.0, 64.0, 32.0, 32.0, np.eye(4))
"""A camera at the origin that looks along z."""


def row(x: np.ndarray, sizes: np.ndarray, opacities: np.ndarray, greys: np.ndarray) -> Gaussians:
    """Balls beside each other at z = 10, from (N,) places, standard deviations, opacities, and colour coefficients."""
    count = len(x)
    means = np.stack([x, np.zeros(count), np.full(count, 10.0)], axis=1)
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    sh = np.repeat(greys[:, None, None], 3, axis=2)
    return Gaussians(means, np.log(np.repeat(sizes[:, None], 3, axis=1)), turns, logit_of(opacities, 1e-6), sh)


def test_importance_is_large_for_what_is_both_large_and_opaque() -> None:
    """A large faint ball contributes most in all, a small opaque one most to a pixel."""
    faint, small, both = 0, 1, 2
    balls = row(np.array([-3.0, 0.0, 3.0]), np.array([1.0, 0.1, 0.25]), np.array([0.05, 0.9, 0.5]), np.zeros(3))
    summed, largest = contributions(balls, [FACING], Rasterizer("cpu"))
    assert summed.argmax() == faint
    assert largest.argmax() == small
    found = importance(balls, [FACING], Rasterizer("cpu"))
    assert found.argmax() == both
    np.testing.assert_allclose(found**2, summed * largest, rtol=1e-6)


def test_distinct_gaussians_are_important() -> None:
    """The difference from the colours of the 9 nearest, itself among them, counts."""
    count, odd = 20, 4
    greys = np.where(np.arange(count) == odd, 1.0, 0.0)
    balls = row(np.linspace(-4.0, 4.0, count), np.full(count, 0.1), np.full(count, 0.5), greys)
    plain = importance(balls, [FACING], Rasterizer("cpu"))
    distinct = importance(balls, [FACING], Rasterizer("cpu"), "distinct") / plain
    assert distinct[odd] == pytest.approx(3 * 8 / 9)
    np.testing.assert_allclose(distinct[odd + 1 : odd + 4], 3 / 9, rtol=1e-6)
    assert not distinct[odd + 6 :].any()


def test_frozen_groups_stay(scene: Gaussians, views: Views, engine: Engine) -> None:
    """Bit for bit, including quaternions, so that rounded values stay rounded."""
    assert set(ORDER) == set(GROUPS)
    start = rounded(scene, DEFAULT, ["log_scales", "quaternions"])
    tuner = FineTuner(engine, views.train, views.background, scene, 0)
    found = tuner.tune(start, 5, frozen=["log_scales", "quaternions", "sh_rest"])
    np.testing.assert_array_equal(found.log_scales, start.log_scales)
    np.testing.assert_array_equal(found.sh[:, 1:], start.sh[:, 1:])
    np.testing.assert_array_equal(rounded(found, DEFAULT, ["quaternions"]).quaternions, start.quaternions)
    for name in ("means", "opacity_logits"):
        assert (getattr(found, name) != getattr(start, name)).any()


def test_cameras_around_a_scene_see_it(scene: Gaussians) -> None:
    cameras = list(cameras_around(scene).values())
    seen = importance(scene, cameras, Rasterizer()) > 0
    assert seen.mean() > 0.95
    with pytest.raises(PocketGSError, match="a single point"):
        cameras_around(scene.select(np.zeros(3, int)))


def test_held_back_views_are_of_both_kinds_and_from_all_sides(scene: Gaussians, engine: Engine) -> None:
    """Around the scene and from its centre: they differ in what a file may lose."""
    cameras = cameras_around(scene)
    centre = np.median(scene.means.astype(np.float64), axis=0)
    views = rendered(scene, cameras, engine, BLACK)
    assert [len(views.train), len(views.judges), len(views.reported)] == [72, 12, 12]
    assert len({frame.name for frame in [*views.train, *views.judges, *views.reported]}) == 96
    for held_back in (views.judges, views.reported):
        places = [frame.camera.centre - centre for frame in held_back]
        assert sum(np.linalg.norm(place) > 1e-6 for place in places) == 6
        quadrants = {tuple(frame.camera.camera_to_world[:2, 2] > 0.0) for frame in held_back}
        assert len(quadrants) == 4
