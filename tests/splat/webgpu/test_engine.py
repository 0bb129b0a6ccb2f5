"""A run of the WebGPU engine gives the same bits every time, whatever happens between two steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pocketgs.capture.capture import Frame
from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import PARAMETERS, Gaussians
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.engine import Engine, EngineOptions
from pocketgs.splat.settings import LossSettings, StepSettings
from pocketgs.splat.webgpu.drawing import draw_once
from pocketgs.splat.webgpu.engine import WebGpuEngine
from pocketgs.splat.webgpu.frame_values import view_values
from splat.training_step import BACKGROUND, RATES, assert_identical, begin, camera_in_front, photograph
from splat.webgpu.variants import every_ordered_variant, every_variant, shared_engine

pytestmark = pytest.mark.usefixtures("adapter")

STEP = StepSettings(RATES, LossSettings(scale_weight=1e-3), background=BACKGROUND)

MakeGaussians = Callable[..., Gaussians]


def train(engine: Engine, steps: int, views: int = 1) -> Gaussians:
    for iteration in range(steps):
        engine.step(iteration % views, STEP)
    return engine.download()


@pytest.fixture
def frames() -> list[Frame]:
    """Three photographs of different sizes, one of them masked."""
    cameras = [camera_in_front(37, 29, 40.0), camera_in_front(80, 60, 80.0, 5.0), camera_in_front(5, 90, 60.0)]
    return [photograph(camera, masked=seed == 1, seed=seed) for seed, camera in enumerate(cameras)]


@every_ordered_variant
def test_same_bits_every_time(make_gaussians: MakeGaussians, options: EngineOptions) -> None:
    frame = photograph(camera_in_front(100, 70, 60.0))
    gaussians = make_gaussians(count=1000, sh_degree=1, size=0.05)
    first = train(begin(WebGpuEngine(options), gaussians, [frame]), 3)
    assert_identical(first, train(begin(WebGpuEngine(options), gaussians, [frame]), 3))
    # An engine that has done other things before is no different.
    used = shared_engine(options)
    train(begin(used, make_gaussians(count=2000, sh_degree=3), [photograph(camera_in_front(90, 90, 20.0))]), 2)
    assert_identical(first, train(begin(used, gaussians, [frame]), 3))


@pytest.mark.parametrize("suffix", ["", " depth"])
def test_an_image_in_bands_of_tiles_has_the_same_bits(make_gaussians: MakeGaussians, suffix: str) -> None:
    """As a host draws that must not keep the GPU busy for long."""
    camera, engine = camera_in_front(100, 70, 60.0), shared_engine(EngineOptions("webgpu"))
    engine.upload(make_gaussians(count=1000, sh_degree=1, size=0.05))
    engine.render(camera)  # makes room
    executor, near = engine.executor, 0.01
    symbols = executor.description.symbols(engine._symbols(camera))
    values = view_values(camera, BACKGROUND, near, symbols)
    expected, needed = draw_once(executor, f"render{suffix}", camera, BACKGROUND, near, symbols)
    assert not needed
    assert np.ptp(expected) > 0.5
    executor.clear("image")
    executor.submit("list splats", symbols)
    for first in range(0, symbols["tiles"], 20):
        executor.write_uniform("view", {**values, "first_tile": first})
        drawn = min(20, symbols["tiles"] - first)
        executor.submit(f"draw tiles{suffix}", {**symbols, "drawn_tiles": drawn})
        image = executor.read("image", np.float32, expected.size).reshape(expected.shape)
        assert (image[64:] != 0).any() == (first + drawn > 8 * 13)
    np.testing.assert_array_equal(image, expected)


@every_ordered_variant
def test_state_restores_training(frames: list[Frame], make_gaussians: MakeGaussians, options: EngineOptions) -> None:
    gaussians = make_gaussians(count=50, sh_degree=0)
    whole = begin(shared_engine(options), gaussians, frames)
    expected = train(whole, 6, views=3)
    state = whole.optimiser_state()
    half = begin(shared_engine(options), gaussians, frames)
    train(half, 3, views=3)
    resumed = WebGpuEngine(options)
    resumed.set_views(frames)
    resumed.upload(half.download(), half.optimiser_state())
    assert_identical(expected, train(resumed, 3, views=3))
    assert resumed.optimiser_state().steps == state.steps == 6
    assert resumed.optimiser_state().first_moments.tobytes() == state.first_moments.tobytes()
    assert resumed.optimiser_state().second_moments.tobytes() == state.second_moments.tobytes()


@pytest.mark.parametrize("sh_degree", [0, 3])
def test_what_is_uploaded_comes_back(make_gaussians: MakeGaussians, sh_degree: int) -> None:
    gaussians = make_gaussians(count=300, sh_degree=sh_degree)
    downloaded = begin(shared_engine(EngineOptions("webgpu")), gaussians).download()
    on_cpu = begin(CpuEngine(1), gaussians).download()
    assert_identical(downloaded, replace(gaussians, quaternions=downloaded.quaternions))
    np.testing.assert_allclose(downloaded.quaternions, on_cpu.quaternions, atol=1e-7)


@every_variant
def test_views_of_different_sizes_in_one_run(
    frames: list[Frame], make_gaussians: MakeGaussians, options: EngineOptions
) -> None:
    gaussians = make_gaussians(count=100, sh_degree=1)
    engines = [begin(engine, gaussians, frames) for engine in (shared_engine(options), CpuEngine(1))]
    losses = []
    for iteration in range(9):
        for engine in engines:
            engine.step(iteration % 3, STEP)
        losses.append([engine.loss() for engine in engines])
    measured, expected = np.array(losses).T
    np.testing.assert_allclose(measured, expected, rtol=1e-3 if options.precision == "f32" else 2e-2)


@every_ordered_variant
def test_rendering_between_steps_changes_nothing(
    frames: list[Frame], make_gaussians: MakeGaussians, options: EngineOptions
) -> None:
    gaussians = make_gaussians(count=200, sh_degree=1)
    expected = train(begin(shared_engine(options), gaussians, frames), 6, views=3)
    engine = begin(WebGpuEngine(options), gaussians, frames)
    # One smaller than the photographs, one larger, and one so near that its tiles' lists need more room.
    cameras = [camera_in_front(3, 3, 4.0), camera_in_front(200, 130, 100.0), camera_in_front(170, 170, 500.0, 2.0)]
    for iteration in range(6):
        engine.step(iteration % 3, STEP)
        engine.render(cameras[iteration // 2], depth=iteration % 2 == 0)
        if iteration == 3:
            engine.download(), engine.optimiser_state(), engine.loss(3), engine.memory()
    assert_identical(expected, engine.download())


def test_views_may_change_during_a_run(frames: list[Frame], make_gaussians: MakeGaussians) -> None:
    gaussians = make_gaussians(count=100, sh_degree=0)
    small, large, _ = frames
    expected = begin(shared_engine(EngineOptions("webgpu")), gaussians, [small, large])
    for view in (0, 0, 1, 1):
        expected.step(view, STEP)
    engine = begin(WebGpuEngine(), gaussians, [small])
    for frame in (small, large):
        engine.set_views([frame])
        for _ in range(2):
            engine.step(0, STEP)
    assert_identical(expected.download(), engine.download())


@every_variant
def test_loss_is_the_mean_of_the_last_steps(
    frames: list[Frame], make_gaussians: MakeGaussians, options: EngineOptions
) -> None:
    engine, cpu = (
        begin(one, make_gaussians(count=100, sh_degree=0), frames) for one in (shared_engine(options), CpuEngine(1))
    )
    losses = []
    for iteration in range(7):
        for one in (engine, cpu):
            one.step(iteration % 3, STEP)
        losses.append(engine.loss())
    for steps in range(1, 8):
        assert engine.loss(steps) == pytest.approx(np.mean(losses[-steps:]), rel=1e-6)
        assert engine.loss(steps) == pytest.approx(cpu.loss(steps), rel=1e-5 if options.precision == "f32" else 1e-2)


def test_loss_leaves_out_steps_that_were_not_taken(frames: list[Frame], make_gaussians: MakeGaussians) -> None:
    engine = begin(WebGpuEngine(), make_gaussians(), frames)
    for view in range(3):
        engine.step(view, STEP)
    assert engine.loss(50) == pytest.approx(engine.loss(3), rel=1e-6)


@every_ordered_variant
def test_what_a_mask_hides_has_no_influence(
    camera: Camera, make_gaussians: MakeGaussians, options: EngineOptions
) -> None:
    frame = photograph(camera, masked=True)
    assert frame.mask is not None
    other = np.where(frame.mask[..., None], frame.image, 255 - frame.image)
    results = [
        train(begin(shared_engine(options), make_gaussians(), [one]), 5) for one in (frame, replace(frame, image=other))
    ]
    assert_identical(*results)


@pytest.mark.parametrize("photometric", ["l2", "l1-dssim"])
def test_a_photograph_that_is_hidden_whole_teaches_nothing(
    camera: Camera, make_gaussians: MakeGaussians, photometric: str
) -> None:
    hidden = replace(photograph(camera), mask=np.zeros((camera.height, camera.width), np.bool_))
    engine = begin(shared_engine(EngineOptions("webgpu")), make_gaussians(), [hidden])
    engine.step(0, StepSettings(RATES, LossSettings(photometric)))  # type: ignore[arg-type]
    assert engine.loss() == pytest.approx(0.0, abs=1e-6)
    assert np.all(engine.optimiser_state().first_moments == 0.0)


@every_variant
def test_no_step_compiles_what_prepare_has_not(
    frames: list[Frame], make_gaussians: MakeGaussians, options: EngineOptions
) -> None:
    engine = shared_engine(options)
    engine.prepare()
    compiled = set(engine.executor._pipelines)
    assert compiled
    begin(engine, make_gaussians(), frames)
    for photometric in ("l2", "l1-dssim"):
        for view in range(3):
            engine.step(view, StepSettings(RATES, LossSettings(photometric, scale_weight=1.0)))  # type: ignore[arg-type]
    engine.render(camera_in_front(2100, 40, 40.0), depth=True)
    assert set(engine.executor._pipelines) == compiled


def test_memory_is_told_by_buffer(frames: list[Frame], make_gaussians: MakeGaussians) -> None:
    gaussians = make_gaussians(count=100, sh_degree=2)
    memory = begin(WebGpuEngine(), gaussians, frames).memory()
    assert memory["shape"] + memory["sh"] >= 4 * 100 + sum(getattr(gaussians, name).nbytes for name in PARAMETERS) - 400
    assert memory["first_moments"] == memory["second_moments"] == 4 * 100 * (10 + 27)
    assert memory["photographs"] == 4 * (37 * 29 + 80 * 60 + 5 * 90)
    assert memory["image"] == 16 * 80 * 60
    assert all(size > 0 for size in memory.values())
