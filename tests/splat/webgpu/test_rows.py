"""Rows that go, stay and are copied on the GPU, against NumPy and against the CPU engine; and what steps sum up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pocketgs.errors import PocketGSError
from pocketgs.geometry.quaternions import of_unit_length
from pocketgs.gpu.adapters import Adapter
from pocketgs.scene.gaussians import PARAMETERS, Gaussians
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.engine import Engine, EngineOptions, OptimiserState
from pocketgs.splat.parameters import ParameterLayout
from pocketgs.splat.rows import RowChange
from pocketgs.splat.settings import LossSettings, PositionNoise, StepSettings
from pocketgs.splat.webgpu.engine import WebGpuEngine
from splat.training_step import BACKGROUND, RATES, assert_identical, begin, camera_in_front, photograph
from splat.webgpu.variants import every_variant, shared_engine

pytestmark = pytest.mark.usefixtures("adapter")

MakeGaussians = Callable[..., Gaussians]
STEP = StepSettings(RATES, LossSettings(), background=BACKGROUND, statistics=True)


def engine_of(scene: Gaussians, state: OptimiserState | None = None, kind: str = "webgpu") -> Engine:
    """An engine about to train on one view."""
    engine = shared_engine(EngineOptions("webgpu")) if kind == "webgpu" else CpuEngine()
    engine.set_views([photograph(camera_in_front(40, 30, 40.0))])
    engine.upload(scene, state)
    return engine


def numbered(count: int, coefficients: int) -> tuple[Gaussians, OptimiserState]:
    """A scene and moments in which every number tells where it comes from."""
    rng = np.random.default_rng(count)
    tails = ((3,), (3,), (4,), (), (coefficients, 3))
    scene = Gaussians(*(rng.normal(size=(count, *tail)) for tail in tails))
    scene.quaternions = scene.unit_quaternions
    moments = rng.normal(size=(2, count, ParameterLayout(coefficients).columns)).astype(np.float32)
    return scene, OptimiserState(moments[0], moments[1], 5, 0.125)


@settings(max_examples=25)
@given(st.data())
def test_rows_change_as_in_numpy(data: st.DataObject) -> None:
    coefficients = data.draw(st.sampled_from([1, 4]))
    scene, state = numbered(data.draw(st.integers(1, 12)), coefficients)
    engine = engine_of(scene, state)
    expected = {name: getattr(scene, name) for name in PARAMETERS}
    moments = [state.first_moments, state.second_moments]
    for _ in range(data.draw(st.integers(1, 3))):
        rows = st.integers(0, engine.count - 1)
        sources = np.array(data.draw(st.lists(rows, min_size=1, max_size=40)), np.int32)
        fresh = np.array(data.draw(st.lists(st.booleans(), min_size=len(sources), max_size=len(sources))))
        values = {}
        for name in data.draw(st.sets(st.sampled_from(PARAMETERS), max_size=2)):
            listed = np.array(data.draw(st.lists(st.integers(0, len(sources) - 1), unique=True)), np.int32)
            numbers = np.random.default_rng(len(listed)).normal(size=(len(listed), *expected[name].shape[1:]))
            values[name] = (listed, numbers.astype(np.float32))
        engine.change_rows(RowChange(sources, fresh, values))
        expected = {key: array[sources] for key, array in expected.items()}
        moments = [np.where(fresh[:, None], 0.0, array[sources]).astype(np.float32) for array in moments]
        for name, (listed, numbers) in values.items():
            expected[name][listed] = of_unit_length(numbers) if name == "quaternions" else numbers
            for array in moments:
                array[listed, ParameterLayout(coefficients).columns_of(name)] = 0.0
        assert engine.count == len(sources)
        assert_identical(engine.download(), Gaussians(*expected.values()))
        found = engine.optimiser_state()
        np.testing.assert_array_equal(found.first_moments, moments[0])
        np.testing.assert_array_equal(found.second_moments, moments[1])
        assert (found.steps, found.near) == (5, 0.125)


def test_training_goes_on_as_if_the_changed_scene_had_been_uploaded(make_gaussians: MakeGaussians) -> None:
    """Over growth beyond the room there was, and over a shorter list: the bits are the same."""
    scene = make_gaussians(count=300, sh_degree=1)
    engine = engine_of(scene)
    engine.step(0, STEP)
    sources = np.array([*range(10, 300), *range(5, 290), 7], np.int32)
    engine.change_rows(RowChange(sources, np.arange(len(sources)) >= 290))
    assert engine.memory()["sh"] == 12 * 4 * len(sources)
    found = []
    changed = (engine.download(), engine.optimiser_state())
    for again in (False, True):
        if again:
            engine = engine_of(*changed)
        engine.step(0, STEP)
        engine.change_rows(RowChange(np.arange(3, 20, dtype=np.int32), np.zeros(17, bool)))
        engine.step(0, STEP)
        assert engine.count == 17
        assert np.isfinite(engine.loss(2))
        found.append((engine.download(), engine.optimiser_state()))
    (scene, state), (other_scene, other_state) = found
    assert_identical(scene, other_scene)
    np.testing.assert_array_equal(state.second_moments, other_state.second_moments)


def test_photographs_stay_while_buffers_grow(make_gaussians: MakeGaussians) -> None:
    """The growing scene leaves less room for photographs, which are then streamed: training is the same."""
    frames = [photograph(camera_in_front(200, 140, 20.0), seed=i) for i in range(10)]
    scene, results = make_gaussians(count=500, sh_degree=0), []
    sources = np.arange(4000, dtype=np.int32) % 500
    for max_memory in (300, 7):
        engine = begin(WebGpuEngine(EngineOptions("webgpu", max_memory=max_memory)), scene, frames)
        engine.step(0, STEP)
        assert all(engine._plan.shelf.is_resident(view) for view in range(10))
        engine.change_rows(RowChange(sources, sources >= 0))
        assert all(engine._plan.shelf.is_resident(view) for view in range(10)) == (max_memory == 300)
        for view in range(10):
            engine.step(view, STEP)
        assert sum(engine.memory().values()) <= max_memory * 1_000_000 + 1000
        results.append(engine.download())
    assert_identical(*results)


def test_what_does_not_fit_is_refused_and_nothing_is_lost(make_gaussians: MakeGaussians) -> None:
    scene = make_gaussians(count=100)
    engine = begin(
        WebGpuEngine(EngineOptions("webgpu", max_memory=20)), scene, [photograph(camera_in_front(9, 9, 9.0))]
    )
    sources = np.zeros(100_000, np.int32)
    with pytest.raises(PocketGSError, match="limit is 20 MB"):
        engine.change_rows(RowChange(sources, sources == 0))
    with pytest.raises(PocketGSError, match="sources name rows 0 to 100, expected 0 to 99"):
        engine.change_rows(RowChange(np.array([0, 100], np.int32), np.zeros(2, bool)))
    assert engine.count == 100
    assert_identical(engine.download(), replace(scene, quaternions=scene.unit_quaternions))
    # Room for half as many again is refused too: it grows by just what is needed.
    engine.change_rows(RowChange(np.zeros(12_000, np.int32), np.zeros(12_000, bool)))
    engine.step(0, STEP)
    assert np.isfinite(engine.loss())


def test_a_scene_that_is_only_drawn_changes_too(make_gaussians: MakeGaussians) -> None:
    scene, camera = make_gaussians(count=30), camera_in_front(20, 20, 20.0)
    engine = WebGpuEngine()
    engine.upload(scene)
    assert not engine.statistics().seen.any()
    engine.change_rows(RowChange(np.arange(10, dtype=np.int32), np.zeros(10, bool)))
    expected = begin(shared_engine(EngineOptions("webgpu")), engine.download()).render(camera, BACKGROUND)
    np.testing.assert_array_equal(engine.render(camera, BACKGROUND).image, expected.image)
    assert not engine.optimiser_state().first_moments.any()


@every_variant
def test_statistics_are_those_of_the_cpu_engine(make_gaussians: MakeGaussians, options: EngineOptions) -> None:
    scene = make_gaussians(count=200, sh_degree=0)
    frames = [photograph(camera_in_front(72, 56, 72.0, distance)) for distance in (3.0, 8.0)]
    still = replace(STEP, rates=RATES.scaled(0.0), loss=LossSettings("l2"))
    engines = [begin(engine, scene, frames) for engine in (shared_engine(options), CpuEngine())]
    for engine in engines:
        for view, collects in ((0, True), (1, True), (1, True), (0, False)):
            engine.step(view, replace(still, statistics=collects, errors=view == 1))
    found, expected = (engine.statistics() for engine in engines)
    exact = options.precision == "f32"
    np.testing.assert_array_equal(found.seen, expected.seen)
    assert set(found.seen) >= {2, 3}
    off = (1e-4 if exact else 1e-2) * found.screen_gradients.max()
    np.testing.assert_allclose(found.screen_gradients, expected.screen_gradients, atol=off)
    np.testing.assert_allclose(found.errors, expected.errors, atol=(1e-4 if exact else 1e-2) * expected.errors.max())
    np.testing.assert_allclose(found.radii, expected.radii, rtol=1e-3 if exact else 2e-2)
    half = replace(expected, screen_gradients=expected.screen_gradients / 2, seen=expected.seen / 2)
    for engine in engines:
        engine.restart_statistics(half)
    np.testing.assert_array_equal(engines[0].statistics().screen_gradients, half.screen_gradients)
    engines[0].step(0, still)
    assert (engines[0].statistics().seen - half.seen).max() == 1
    engines[0].change_rows(RowChange.of_values(200, {}))
    assert not engines[0].statistics().seen.any()


def test_halted_steps_are_counted_once(make_gaussians: MakeGaussians) -> None:
    """Steps that found too little room are repeated, and enter the sums when they are completed."""
    scene = make_gaussians(count=300, sh_degree=0)
    frames = [photograph(camera_in_front(72, 56, 72.0, distance)) for distance in (60.0, 3.0)]
    engines = [begin(WebGpuEngine(), scene, frames) for _ in range(2)]
    engines[1]._fit(replace(engines[1]._extent, intersections=20))
    for engine in engines:
        engine._ahead.most = 8
        for view in (0, 0, 1, 1):
            engine.step(view, replace(STEP, errors=True))
    for name in ("screen_gradients", "seen", "radii", "errors"):
        np.testing.assert_array_equal(*(getattr(engine.statistics(), name) for engine in engines))
    assert_identical(*(engine.download() for engine in engines))


def test_steps_of_every_kind_are_those_of_the_cpu_engine(make_gaussians: MakeGaussians) -> None:
    """Degrees that wait, sizes that weigh, and positions that are shaken."""
    scene = make_gaussians(count=60, sh_degree=2)
    scene.opacity_logits[:20] = -5.0
    kinds = {
        "degree": replace(STEP, sh_degree=1),
        "size": replace(STEP, loss=LossSettings(size_weight=0.3)),
        "noise": replace(STEP, rates=RATES.scaled(0.0), noise=PositionNoise(30.0, 4_000_000_000)),
    }
    for kind, step in kinds.items():
        step = replace(step, adam=replace(step.adam, epsilon=1e-6))
        engines = [engine_of(scene, kind=each) for each in ("webgpu", "cpu")]
        for engine in engines:
            engine.step(0, step)
            engine.step(0, step)
        found, expected = (engine.download() for engine in engines)
        for name in PARAMETERS:
            values = getattr(found, name), getattr(expected, name)
            np.testing.assert_allclose(*values, atol=3e-4, err_msg=f"{kind} {name}")
        assert engines[0].loss(2) == pytest.approx(engines[1].loss(2), rel=1e-4)
        if kind == "degree":
            np.testing.assert_array_equal(found.sh[:, 4:], scene.sh[:, 4:])
        if kind == "noise":
            assert np.abs(found.means[:20] - scene.means[:20]).max() > 0.01
            np.testing.assert_array_equal(found.opacity_logits, scene.opacity_logits)


def test_adapters_without_anything_change_rows(adapter: Adapter, make_gaussians: MakeGaussians) -> None:
    engine = WebGpuEngine(EngineOptions("webgpu", portable=True))
    engine.upload(make_gaussians(count=5))
    engine.change_rows(RowChange(np.zeros(0, np.int32), np.zeros(0, bool)))
    assert engine.count == len(engine.download()) == 0
    assert not engine.render(camera_in_front(8, 8, 8.0)).alpha.any(), adapter.name
