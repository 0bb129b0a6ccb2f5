"""Room in the GPU's memory: lists that outgrow theirs, photographs that do not all fit, limits that are kept."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from pocketgs.capture.capture import Frame
from pocketgs.errors import PocketGSError
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import EngineOptions
from pocketgs.splat.rows import RowChange
from pocketgs.splat.settings import LossSettings, StepSettings
from pocketgs.splat.webgpu import engine as engine_module
from pocketgs.splat.webgpu import steps_ahead
from pocketgs.splat.webgpu.engine import WebGpuEngine
from pocketgs.splat.webgpu.memory import ROW_GROWTH, Extent, MemoryLimits, plan_memory, plan_rows
from pocketgs.splat.webgpu.passes import describe_training
from pocketgs.splat.webgpu.variant import Variant
from splat.training_step import BACKGROUND, RATES, assert_identical, begin, camera_in_front, photograph
from splat.webgpu.variants import every_ordered_variant, shared_engine

pytestmark = pytest.mark.usefixtures("adapter")

STEP = StepSettings(RATES, LossSettings(), background=BACKGROUND)

MakeGaussians = Callable[..., Gaussians]


@pytest.fixture
def cramped(monkeypatch: pytest.MonkeyPatch) -> None:
    """Engines begin with next to no room for intersections."""
    monkeypatch.setattr(engine_module, "INTERSECTIONS_PER_GAUSSIAN", 0)
    monkeypatch.setattr(engine_module, "MIN_INTERSECTIONS", 20)


@pytest.fixture
def frames() -> list[Frame]:
    """From far away, where a Gaussian reaches few tiles, and from near."""
    return [photograph(camera_in_front(72, 56, 72.0, distance)) for distance in (60.0, 8.0, 3.0)]


def room(engine: WebGpuEngine) -> int:
    """Intersections that the lists of tiles have room for."""
    return engine.memory()["tile_keys"] // 4


def step_and_look(engine: WebGpuEngine, view: int) -> float:
    """Train on a view, and wait for it."""
    engine.step(view, STEP)
    return engine.loss()


def approach(engine: WebGpuEngine, look_every_step: bool) -> list[int]:
    """Train from nearer and nearer; the room there was for intersections at each distance."""
    rooms = [room(engine)]
    for view in (0, 1, 2, 0):
        for _ in range(2):
            engine.step(view, STEP)
            if look_every_step:
                engine.loss()
        rooms.append(room(engine))
    return rooms


@every_ordered_variant
@pytest.mark.parametrize("look_every_step", [True, False])
@pytest.mark.usefixtures("cramped")
def test_lists_that_outgrow_their_room_in_the_middle_of_a_run(
    monkeypatch: pytest.MonkeyPatch,
    frames: list[Frame],
    make_gaussians: MakeGaussians,
    options: EngineOptions,
    look_every_step: bool,
) -> None:
    gaussians = make_gaussians(count=300, sh_degree=1)
    engine = WebGpuEngine(options)
    # Left alone, the host looks only at the end: all steps after the first one that found too little are repeated.
    monkeypatch.setattr(steps_ahead, "SECONDS_AHEAD", math.inf)
    monkeypatch.setattr(engine._ahead, "most", steps_ahead.MAX_PENDING)
    rooms = approach(begin(engine, gaussians, frames), look_every_step)
    losses = [engine.loss(steps) for steps in range(1, 9)]
    assert room(engine) > 2 * rooms[0]
    if look_every_step:
        assert rooms[0] < rooms[1] < rooms[2] < rooms[3] == rooms[4]
    monkeypatch.undo()
    spacious = begin(shared_engine(options), gaussians, frames)
    approach(spacious, look_every_step)
    assert room(spacious) >= engine_module.MIN_INTERSECTIONS
    assert_identical(spacious.download(), engine.download())
    assert losses == [spacious.loss(steps) for steps in range(1, 9)]
    states = [one.optimiser_state() for one in (spacious, engine)]
    assert states[0].steps == states[1].steps == 8
    assert states[0].second_moments.tobytes() == states[1].second_moments.tobytes()


@every_ordered_variant
@pytest.mark.usefixtures("cramped")
def test_lists_that_outgrow_their_room_while_rendering(make_gaussians: MakeGaussians, options: EngineOptions) -> None:
    gaussians = make_gaussians(count=300, sh_degree=1)
    engine = begin(WebGpuEngine(options), gaussians)
    before = room(engine)
    camera = camera_in_front(72, 56, 72.0)
    rendering = engine.render(camera, BACKGROUND, depth=True)
    assert room(engine) > before
    expected = begin(shared_engine(options), gaussians).render(camera, BACKGROUND, depth=True)
    for name in ("image", "alpha", "depth"):
        np.testing.assert_array_equal(getattr(rendering, name), getattr(expected, name))


@pytest.mark.usefixtures("cramped")
def test_room_that_is_refused_leaves_the_engine_usable(
    monkeypatch: pytest.MonkeyPatch, frames: list[Frame], make_gaussians: MakeGaussians
) -> None:
    far, near = 0, 2
    engine = begin(WebGpuEngine(), make_gaussians(count=300), frames)
    step_and_look(engine, far)
    taken = sum(engine.memory().values())
    monkeypatch.setattr(engine, "_limits", replace(engine._limits, total=taken))
    with pytest.raises(PocketGSError, match="of GPU memory, the limit is"):
        engine.render(frames[near].camera)
    with pytest.raises(PocketGSError, match="of GPU memory, the limit is"):
        step_and_look(engine, near)
    assert engine.render(frames[far].camera).alpha.max() > 0.0
    assert np.isfinite(step_and_look(engine, far))
    assert engine.optimiser_state().steps == 2
    assert sum(engine.memory().values()) == taken


@pytest.mark.usefixtures("cramped")
def test_a_rendering_that_needs_more_room_leaves_the_run_alone(
    frames: list[Frame], make_gaussians: MakeGaussians
) -> None:
    far, _, near = frames
    gaussians = make_gaussians(count=300, sh_degree=0)
    engine, undisturbed = (begin(WebGpuEngine(), gaussians, [far]) for _ in range(2))
    for iteration in range(6):
        engine.step(0, STEP)
        undisturbed.step(0, STEP)
        if iteration == 2:
            engine.render(near.camera)
    assert room(engine) > room(undisturbed)
    assert_identical(undisturbed.download(), engine.download())


def test_photographs_that_do_not_fit_are_streamed(
    monkeypatch: pytest.MonkeyPatch, make_gaussians: MakeGaussians
) -> None:
    gaussians = make_gaussians(count=50, sh_degree=0)
    frames = [photograph(camera_in_front(60 + 2 * i, 45, 20.0), masked=i % 2 == 0, seed=i) for i in range(10)]
    resident = begin(WebGpuEngine(), gaussians, frames)
    sizes = resident.memory()
    assert sizes["photographs"] == 4 * sum(frame.image[..., 0].size for frame in frames)
    without = sum(sizes.values()) - sizes["photographs"]
    streaming = WebGpuEngine()
    limits = replace(streaming._limits, total=without + sizes["photographs"] // 2)
    monkeypatch.setattr(streaming, "_limits", limits)
    begin(streaming, gaussians, frames)
    assert {streaming._plan.shelf.is_resident(view) for view in range(10)} == {True, False}
    order = np.random.default_rng(0).permutation(np.repeat(np.arange(10), 2))
    for engine in (resident, streaming):
        for view in order:
            engine.step(int(view), STEP)
    assert streaming.loss(20) == resident.loss(20)
    assert_identical(resident.download(), streaming.download())


@pytest.mark.parametrize("replay", ["recompute", "cache"])
def test_headroom_displaces_neither_photographs_nor_the_replay_cache(replay: Literal["recompute", "cache"]) -> None:
    """Whatever the limit, what is allocated for more Gaussians has a place for what fits without headroom."""
    description = describe_training(Variant(replay=replay))
    before = Extent(1000, 1000, 4, 8000, ((300, 200),) * 10, trains=True)
    grown = replace(before, gaussians=1100, capacity=1100)
    capacities = set()
    for total in range(4_000_000, 30_000_000, 460_000):
        limits = MemoryLimits(total, total)
        try:
            exact = plan_memory(description, grown, limits)
        except PocketGSError:
            continue
        extent, plan = plan_rows(description, before, 1100, limits)
        assert plan.total <= total
        assert (plan.shelf, plan.replay_depth) == (exact.shelf, exact.replay_depth)
        capacities.add(extent.capacity)
    assert capacities == {1100, int(ROW_GROWTH * 1000)}


@pytest.mark.parametrize("first", [9_000, 16_000, 19_990])
def test_a_growing_run_takes_no_more_than_planned(monkeypatch: pytest.MonkeyPatch, first: int) -> None:
    """Nor while rows are gathered, or all opacities set."""
    most, coefficients, camera = 20_000, 16, camera_in_front(64, 48, 60.0)
    engine = WebGpuEngine()
    needed = engine.memory_needed(most, coefficients, [(64, 48)]).device
    taken = []
    reserve = engine.executor.reserve

    def watched(sizes: Mapping[str, int]) -> None:
        reserve(sizes)
        taken.append(sum(engine.memory().values()))

    monkeypatch.setattr(engine.executor, "reserve", watched)
    tails = ((3,), (3,), (4,), (), (coefficients, 3))
    begin(engine, Gaussians(*(np.ones((first, *tail)) for tail in tails)), [photograph(camera)])
    for count in np.linspace(first, most, 5).astype(int)[1:]:
        sources = np.arange(count, dtype=np.int32) % engine.count
        rows = np.arange(count, dtype=np.int32)
        opacities = np.full(count, -3.0, np.float32)
        engine.change_rows(RowChange(sources, sources < 0, {"opacity_logits": (rows, opacities)}))
    assert np.all(engine.download().opacity_logits == -3.0)
    assert 0.5 * needed < max(taken) <= needed


def test_memory_stays_within_its_limit(make_gaussians: MakeGaussians) -> None:
    frames = [photograph(camera_in_front(300, 200, 20.0), seed=i) for i in range(10)]
    for max_memory in (20, 30, 60):
        options = EngineOptions("webgpu", replay="cache", max_memory=max_memory)
        engine = begin(WebGpuEngine(options), make_gaussians(count=500), frames)
        for view in (0, 9, 4):
            engine.step(view, STEP)
        assert np.isfinite(engine.loss(3))
        assert sum(engine.memory().values()) <= 1_000_000 * max_memory + 1000


@pytest.mark.parametrize("what", ["scene", "images"])
def test_more_than_the_limit_is_refused(make_gaussians: MakeGaussians, what: str) -> None:
    engine = WebGpuEngine(EngineOptions("webgpu", max_memory=20))
    gaussians = make_gaussians(count=50_000 if what == "scene" else 10)
    size = (1500, 1500) if what == "images" else (30, 20)
    with pytest.raises(PocketGSError, match="limit is 20 MB"):
        begin(engine, gaussians, [photograph(camera_in_front(*size, 9.0))])


def test_more_than_the_device_can_hold_is_refused(make_gaussians: MakeGaussians) -> None:
    engine = begin(WebGpuEngine(EngineOptions("webgpu", max_memory=10**9)), make_gaussians())
    wide = camera_in_front(8, 8, 8.0)
    with pytest.raises(PocketGSError, match="the device allows"):
        engine.render(replace(wide, width=10**6, height=10**6))
    # And the engine goes on.
    assert np.all(np.isfinite(engine.render(wide).image))
