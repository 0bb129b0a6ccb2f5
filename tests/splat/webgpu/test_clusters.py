"""Culling by clusters on the GPU: the same bits as with every cluster in view."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from pocketgs.gpu.sizes import ceil_div
from pocketgs.gpu.workgroups import THREADS
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import EngineOptions
from pocketgs.splat.settings import AdamSettings, LossSettings, PositionNoise
from pocketgs.splat.webgpu.engine import WebGpuEngine
from splat.test_clusters import FAST, a_camera, around
from splat.test_lenses import BENT, CULLED_THROUGH, at_a_corner, through
from splat.training_step import assert_identical, begin, photograph
from splat.webgpu.variants import shared_engine

pytestmark = pytest.mark.usefixtures("adapter")

OUTSIDE = 0xFFFFFFFF
ENGINE = EngineOptions("webgpu")
VIEWS = (0, 1, 2, 3, 4, 5, 0, 2)


def small_ones(seed: int, count: int, shrinking: float = 4.0) -> Gaussians:
    """Gaussians whose clusters are not wider than the scene."""
    scene = around(seed, count)
    scene.log_scales -= np.float32(shrinking)
    return scene


def see_everything(engine: WebGpuEngine) -> None:
    """Give every cluster bounds that no view misses."""
    bounds = np.array([-1e30] * 3 + [1e30] * 3 + [0.0, 1.0], np.float32)
    engine.executor.write("cluster_bounds", np.tile(bounds, ceil_div(engine.count, THREADS)))


def in_view(engine: WebGpuEngine) -> np.ndarray:
    """(clusters,) bool, of the last image."""
    return engine.executor.read("cluster_places", np.uint32, ceil_div(engine.count, THREADS)) != OUTSIDE


@pytest.mark.parametrize(
    ("seen_only", "scale_weight", "noise"), [(True, 0.0, 0.0), (False, 0.0, 0.0), (True, 0.1, 0.0), (True, 0.0, 0.02)]
)
def test_training_is_the_same_with_and_without_culling(seen_only: bool, scale_weight: float, noise: float) -> None:
    """On views all around, with rates at which Gaussians leave their clusters' first bounds."""
    scene = small_ones(3, 4000, 1.5)
    rng = np.random.default_rng(5)
    frames = [photograph(a_camera(rng), seed=seed) for seed in range(6)]
    loss = LossSettings(scale_weight=scale_weight)
    step = replace(FAST, adam=AdamSettings(seen_only=seen_only), loss=loss, statistics=True)
    if noise:
        step = replace(step, noise=PositionNoise(noise, 7))
    results = []
    for culls in (True, False):
        engine = begin(shared_engine(ENGINE), scene, frames)
        shares = []
        for view in VIEWS:
            if not culls:
                see_everything(engine)
            engine.step(view, step)
            engine.loss()
            shares.append(in_view(engine).mean())
        assert (np.mean(shares) < 0.9) == culls
        images = []
        for frame in frames:
            if not culls:
                see_everything(engine)
            images.append(engine.render(frame.camera).image)
        results.append((engine.download(), engine.optimiser_state(), engine.statistics(), images))
    (scene_of_one, state, statistics, images), (other, other_state, other_statistics, other_images) = results
    assert_identical(scene_of_one, other)
    np.testing.assert_array_equal(state.first_moments, other_state.first_moments)
    np.testing.assert_array_equal(state.second_moments, other_state.second_moments)
    np.testing.assert_array_equal(statistics.screen_gradients, other_statistics.screen_gradients)
    for one, another in zip(images, other_images, strict=True):
        np.testing.assert_array_equal(one, another)
    assert np.abs(scene_of_one.means - scene.means).max() > 0.1


@pytest.mark.parametrize(("lens", "seed"), [*product(["pinhole"], range(6)), *product(BENT, (1, 2))])
def test_no_bits_of_a_rendering_change(lens: str, seed: int) -> None:
    scene, camera = small_ones(seed, 12_000), through(a_camera(np.random.default_rng(seed)), lens)
    engine = begin(shared_engine(ENGINE), scene)
    culled = engine.render(camera)
    assert not in_view(engine).all()
    see_everything(engine)
    whole = engine.render(camera)
    assert in_view(engine).all()
    np.testing.assert_array_equal(culled.image, whole.image)


@pytest.mark.parametrize("name", CULLED_THROUGH)
def test_culling_through_a_lens_loses_nothing_at_a_corner(name: str) -> None:
    scene, camera, visible = at_a_corner(name, THREADS)
    engine = begin(shared_engine(ENGINE), scene)
    engine.render(camera)
    assert not np.any(visible & ~in_view(engine))


def test_numbers_that_are_none_do_not_widen_bounds() -> None:
    scene = small_ones(1, 12_000)
    camera = a_camera(np.random.default_rng(4))
    engine = begin(shared_engine(ENGINE), scene)
    engine.render(camera)
    before = in_view(engine)
    assert not before.all()
    rng = np.random.default_rng(6)
    for array in (scene.means, scene.log_scales):
        array[rng.choice(len(scene), 60, replace=False), rng.integers(0, 3)] = np.nan
    scene.means[rng.choice(len(scene), 20), 1] = np.inf
    engine.upload(scene)
    image = engine.render(camera).image
    assert np.all(np.isfinite(image))
    assert not np.any(in_view(engine) & ~before)
