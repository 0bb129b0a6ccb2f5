"""Culling by clusters: no visible Gaussian is skipped, and bounds follow moving Gaussians."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pocketgs.geometry.camera import Camera, look_at
from pocketgs.scene.gaussians import Gaussians
from pocketgs.scene.morton import morton_order
from pocketgs.splat.cpu import clusters as clusters_module
from pocketgs.splat.cpu.clusters import Clusters
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.cpu.layout import CLUSTER, View
from pocketgs.splat.cpu.lenses.lens import kernel_lens
from pocketgs.splat.reference.project import project
from pocketgs.splat.reference.scene import Scene
from pocketgs.splat.settings import AdamSettings, LearningRates, LossSettings, PositionNoise, StepSettings
from splat.training_step import assert_identical, camera_in_front, photograph

FAST = StepSettings(LearningRates(0.05, 0.1, 0.05, 0.05, 0.05, 0.01), LossSettings(), AdamSettings(seen_only=True))


def around(seed: int, count: int = 3000, spread: float = 6.0) -> Gaussians:
    """Gaussians on all sides of the cameras, of all sizes, in Morton order."""
    rng = np.random.default_rng(seed)
    means = rng.normal(size=(count, 3)) * spread
    scene = Gaussians(
        means,
        rng.uniform(-5.0, 0.0, (count, 3)),
        rng.normal(size=(count, 4)),
        rng.uniform(-3.0, 4.0, count),
        rng.normal(size=(count, 1, 3)),
    )
    return scene.select(morton_order(scene.means))


def a_camera(rng: np.random.Generator) -> Camera:
    """A camera near the middle with random orientation and an off-centre principal point."""
    pose = look_at(rng.normal(size=3), rng.normal(size=3) * 5.0, rng.normal(size=3))
    width, height = (int(side) for side in rng.integers(5, 80, 2))
    return Camera(width, height, *rng.uniform(10.0, 90.0, 2), *(rng.uniform(-0.2, 1.2, 2) * (width, height)), pose)


@settings(max_examples=60)
@given(st.integers(0, 10_000))
def test_what_is_visible_is_in_a_cluster_in_view(seed: int) -> None:
    scene, camera = around(seed), a_camera(np.random.default_rng(seed))
    near = 0.05
    found = Clusters(len(scene)).in_view(scene, View.of(camera), kernel_lens(camera), near, 2)
    visible = np.flatnonzero(project(Scene.of(scene), camera, near).visible)
    assert np.isin(visible // CLUSTER, found).all()


def test_a_view_of_a_part_needs_few_clusters() -> None:
    scene = around(1, 40_000)
    scene.log_scales -= 5.0
    narrow = camera_in_front(40, 30, 120.0)
    found = Clusters(len(scene)).in_view(scene, View.of(narrow), kernel_lens(narrow), 0.05, 2)
    assert 0 < len(found) < 0.5 * len(scene) / CLUSTER


@pytest.mark.parametrize("seen_only", [True, False])
@pytest.mark.parametrize("scale_weight", [0.0, 0.1])
def test_training_is_the_same_with_and_without_culling(
    monkeypatch: pytest.MonkeyPatch, seen_only: bool, scale_weight: float
) -> None:
    """On views all around, with rates at which Gaussians leave the initial bounds of their clusters."""
    scene = around(3, 4000)
    rng = np.random.default_rng(5)
    frames = [photograph(a_camera(rng), seed=seed) for seed in range(6)]
    step = replace(FAST, adam=AdamSettings(seen_only=seen_only), loss=LossSettings(scale_weight=scale_weight))

    def trained() -> tuple[Gaussians, list[np.ndarray]]:
        engine = CpuEngine(2)
        engine.set_views(frames)
        engine.upload(scene)
        for view in (0, 1, 2, 3, 4, 5, 0, 2, 5, 1, 3, 4):
            engine.step(view, step)
        return engine.download(), [engine.render(frame.camera).image for frame in frames]

    culled, pictures = trained()
    monkeypatch.setattr(clusters_module, "outside", lambda bounds, view, lens, near: np.zeros(len(bounds), bool))
    whole, whole_pictures = trained()
    assert_identical(culled, whole)
    for one, other in zip(pictures, whole_pictures, strict=True):
        np.testing.assert_array_equal(one, other)
    assert np.abs(culled.means - scene.means).max() > 0.1


def test_what_noise_moves_into_the_view_is_drawn() -> None:
    """A step of `seen_only` updates the clusters in view alone, but noise moves the others as well."""
    camera, rng = camera_in_front(40, 30, 60.0), np.random.default_rng(6)
    means = rng.uniform(-0.5, 0.5, (2 * CLUSTER, 3))
    means[CLUSTER:, 0] += 4.0
    scene = Gaussians(
        means,
        np.full(means.shape, np.log(0.3)),
        np.tile([1.0, 0, 0, 0], (len(means), 1)),
        np.full(len(means), np.log(0.0045)),
        np.ones((len(means), 1, 3)),
    )
    engine, other = CpuEngine(), CpuEngine()
    engine.set_views([photograph(camera)])
    engine.upload(scene)
    engine.step(0, replace(FAST, noise=PositionNoise(50.0, 3)))
    shaken, found = engine.download(), engine.render(camera).image
    other.upload(shaken)
    np.testing.assert_array_equal(found, other.render(camera).image)
    other.upload(shaken.select(np.arange(CLUSTER, 2 * CLUSTER)))
    assert other.render(camera).image.any()


def test_numbers_that_are_none_do_not_widen_bounds(make_gaussians: Callable[..., Gaussians]) -> None:
    gaussians = make_gaussians(count=5)
    camera = camera_in_front(30, 20, 30.0)
    before = CpuEngine()
    before.upload(gaussians)
    expected = before.render(camera).image
    gaussians.means[1, 0], gaussians.log_scales[2, 1] = np.nan, np.nan
    keep = np.array([0, 3, 4])
    engine = CpuEngine()
    engine.upload(gaussians)
    found = engine.render(camera).image
    engine.upload(gaussians.select(keep))
    np.testing.assert_array_equal(engine.render(camera).image, found)
    assert np.any(expected != found)


def test_morton_order_keeps_neighbours_together() -> None:
    rng = np.random.default_rng(2)
    means = rng.uniform(-3.0, 5.0, (20_000, 3))
    means[7], means[11, 1] = np.nan, np.inf
    order = morton_order(means)
    assert sorted(order) == list(range(len(means)))
    assert set(order[-2:]) == {7, 11}
    steps = np.linalg.norm(np.diff(means[order[:-2]], axis=0), axis=1)
    assert np.median(steps) < 0.6
    assert np.array_equal(morton_order(np.ones((9, 3))), np.arange(9))
    assert len(morton_order(np.empty((0, 3)))) == 0
