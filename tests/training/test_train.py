"""Training: reproducible, within its budgets, improving, and able to stop and resume.

All runs start from the capture's own points; other starting points have their own tests.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pocketgs import Capture, Gaussians, PocketGSError
from pocketgs.capture.capture import Frame
from pocketgs.metrics.evaluation import psnr
from pocketgs.prior.prior import PreparedCapture
from pocketgs.scene.gaussians import PARAMETERS
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.rendering import render
from pocketgs.splat.settings import StepSettings
from pocketgs.training import loop
from pocketgs.training.options import TrainingOptions
from pocketgs.training.progress import Progress
from pocketgs.training.recipes import RECIPES
from pocketgs.training.result import Checkpoint
from pocketgs.training.train import train as prepare_and_train
from pocketgs.training.validation import mean_psnr

train = partial(prepare_and_train, prior="none")


def bits(scene: Gaussians) -> list[bytes]:
    return [getattr(scene, name).tobytes() for name in PARAMETERS]


def quality(scene: Gaussians, frames: Sequence[Frame]) -> float:
    """Mean PSNR of the views, rendered as a user would."""
    images = [np.clip(render(scene, frame.camera).image, 0, 1) for frame in frames]
    return float(np.mean([psnr(image, frame.image / 255.0) for image, frame in zip(images, frames, strict=True)]))


@pytest.fixture
def steps(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, StepSettings]]:
    """Records the views and settings of all steps; the engine works as usual."""
    taken: list[tuple[int, StepSettings]] = []

    class ListeningEngine(CpuEngine):
        def step(self, view: int, settings: StepSettings) -> None:
            taken.append((view, settings))
            super().step(view, settings)

    monkeypatch.setattr("pocketgs.training.train.create_engine", lambda options: ListeningEngine(options.threads))
    return taken


def test_same_seed_same_bits(small_capture: Capture) -> None:
    one, same, other = (train(small_capture, iterations=15, seed=seed).scene for seed in (3, 3, 4))
    assert bits(one) == bits(same)
    assert bits(one) != bits(other)


def test_number_of_threads_does_not_matter_much(small_capture: Capture) -> None:
    one, two = (train(small_capture, iterations=15, threads=threads).scene for threads in (1, 2))
    assert abs(quality(one, small_capture.held_out) - quality(two, small_capture.held_out)) < 0.1


def test_quality_improves(small_capture: Capture) -> None:
    first = quality(train(small_capture, iterations=1).scene, small_capture.held_out)
    result = train(small_capture, iterations=60)
    assert quality(result.scene, small_capture.held_out) > first + 3
    assert (result.iterations, result.interrupted, len(result.scene)) == (60, False, 2000)


def test_every_step_of_the_reference_recipe_helps(small_capture: Capture) -> None:
    first, last = (train(small_capture, iterations=count, recipe="reference").scene for count in (1, 60))
    assert quality(last, small_capture.held_out) > quality(first, small_capture.held_out) + 0.5


def test_every_view_is_used_once_an_epoch(small_capture: Capture, steps: list[tuple[int, StepSettings]]) -> None:
    count = len(small_capture.train)
    train(small_capture, iterations=4 * count, evaluate_every=0)
    epochs = np.array([view for view, _ in steps]).reshape(4, count)
    assert all(sorted(epoch) == list(range(count)) for epoch in epochs.tolist())
    assert len({tuple(epoch) for epoch in epochs.tolist()}) > 1


@pytest.mark.parametrize("recipe", ["pocketgs", "reference"])
def test_rates_fall_as_the_recipe_says(
    small_capture: Capture, steps: list[tuple[int, StepSettings]], recipe: str
) -> None:
    train(small_capture, iterations=20, recipe=recipe)
    assert small_capture.points is not None
    unit = RECIPES[recipe].length([frame.camera for frame in small_capture.train], small_capture.points)
    initial = replace(RECIPES[recipe].rates, means=RECIPES[recipe].rates.means * unit)
    for number, (_, settings) in enumerate(steps):
        assert settings.rates == RECIPES[recipe].schedule(initial, number / 20)
        assert settings.loss == RECIPES[recipe].loss
        assert settings.adam == RECIPES[recipe].adam
        assert settings.background == small_capture.background


def test_time_budget(small_capture: Capture, steps: list[tuple[int, StepSettings]]) -> None:
    told: list[Progress] = []
    options = TrainingOptions(iterations=10**6, time_budget=1.0, evaluate_every=0, prior="none")
    result = train(small_capture, options, observer=told.append)
    assert 1 <= result.iterations < 10**5
    assert result.interrupted is False
    rates = [settings.rates.means for _, settings in steps]
    assert all(later <= earlier for earlier, later in pairwise(rates))
    # The cosine has nearly reached its end, though hardly any of the iterations have been done.
    assert rates[-1] < 0.1 * rates[0]
    assert told[-1].fraction > 0.9
    assert 0 <= told[-1].seconds_left < 0.5


def test_time_budget_that_is_over_at_once(small_capture: Capture) -> None:
    result = train(small_capture, time_budget=1e-9)
    assert result.iterations == 0
    assert np.isfinite(result.scene.means).all()


def test_an_observer_may_pause_a_run_but_a_saver_takes_of_its_time(small_capture: Capture) -> None:
    def slow(progress: Progress) -> None:
        time.sleep(0.1)

    saved = train(small_capture, iterations=40, time_budget=1.0, evaluate_every=0, saver=slow)
    paused = train(small_capture, iterations=12, time_budget=1.0, evaluate_every=0, observer=slow)
    assert 1 <= saved.iterations <= 10
    assert paused.iterations == 12


def test_capture_without_points(small_capture: Capture) -> None:
    bare = replace(small_capture, points=None)
    scene = train(bare, iterations=60, max_gaussians=1500).scene
    assert 4 <= len(scene) <= 1500
    assert quality(scene, bare.held_out) > 16
    assert bits(scene) == bits(train(bare, iterations=60, max_gaussians=1500).scene)


def test_max_gaussians(small_capture: Capture) -> None:
    scene = train(small_capture, iterations=2, max_gaussians=321).scene
    assert len(scene) == 321


def test_prior_by_name(small_capture: Capture) -> None:
    plain, matched = (prepare_and_train(small_capture, prior=prior, iterations=1) for prior in ("none", "sparse"))
    assert plain.prior is None
    assert matched.prior is not None


def test_seeds_by_name(small_capture: Capture) -> None:
    discs, balls = (
        train(small_capture, iterations=1, time_budget=1e-9, seeds=seeds).scene for seeds in ("discs", "balls")
    )
    assert np.allclose(balls.scales, balls.scales[:, :1])
    assert np.all(discs.scales[:, 2] < 0.5 * discs.scales[:, 0])


def test_neighbours_that_the_gpu_has_no_room_for(small_capture: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    narrow = SimpleNamespace(name="webgpu", most_points=10)
    monkeypatch.setattr("pocketgs.training.train.create_search", lambda *_: narrow)
    report = prepare_and_train(small_capture, prior="sparse", iterations=1).prior
    assert report is not None
    assert report.warnings[-1].startswith("neighbours are found on the CPU")


def test_what_is_prepared_is_not_prepared_again(small_capture: Capture) -> None:
    assert small_capture.points is not None
    fewer = replace(small_capture, points=small_capture.points.select(np.arange(150)))
    scene = prepare_and_train(PreparedCapture.of(fewer, None), iterations=1).scene
    assert len(scene) == 150


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_sh_degree(small_capture: Capture, degree: int) -> None:
    scene = train(small_capture, iterations=8, sh_degree=degree).scene
    assert scene.sh_degree == degree
    assert all(scene.sh[:, number].any() for number in range((degree + 1) ** 2))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"iterations": 0}, "iterations: found 0, expected at least 1"),
        ({"time_budget": 0.0}, "time budget: found 0.0, expected seconds above 0"),
        ({"time_budget": float("nan")}, "time budget: found nan"),
        ({"max_gaussians": 3}, "max gaussians: found 3, expected at least 4"),
        ({"sh_degree": 4}, "SH degree: found 4, expected 0, 1, 2 or 3"),
        ({"sh_degree": -1}, "SH degree: found -1"),
        ({"threads": 0}, "threads: found 0, expected at least 1"),
        ({"evaluate_every": -1}, "evaluate every: found -1, expected at least 0"),
        ({"seed": -1}, "seed: found -1, expected at least 0"),
        ({"recipe": "fast"}, "recipe 'fast': not known, expected one of pocketgs, reference"),
        ({"prior": "best"}, "prior: found best, expected dense, sparse, colmap or none"),
        ({"seeds": "cubes"}, "seeds: found cubes, expected discs or balls"),
        ({"source_views": 0}, "source views: found 0, expected at least 1"),
        ({"max_keyframes": 1}, "max keyframes: found 1, expected at least 2"),
        ({"exposure": "maybe"}, "exposure: found maybe, expected auto, on or off"),
        ({"engine": "gpu"}, "engine 'gpu': not known, expected one of auto, cpu, webgpu"),
        ({"gpu": "voodoo", "engine": "webgpu"}, "expected one named like 'voodoo', or --engine cpu"),
        ({"precision": "f64"}, "precision: found 'f64', expected f32 or f16"),
        ({"replay": "never"}, "replay: found 'never', expected recompute or cache"),
        ({"accumulation": "none"}, "accumulation: found 'none', expected ordered or atomic"),
        ({"max_memory": 0}, "max memory: found 0, expected at least 1"),
    ],
)
def test_bad_options_are_named(small_capture: Capture, change: dict[str, Any], message: str) -> None:
    with pytest.raises(PocketGSError) as caught:
        train(small_capture, **change)
    assert message in str(caught.value)


def test_capture_without_training_views(small_capture: Capture) -> None:
    for points in (small_capture.points, None):
        with pytest.raises(PocketGSError, match="no training view"):
            train(replace(small_capture, train=[], points=points))


def test_one_training_view(small_capture: Capture) -> None:
    alone = replace(small_capture, train=small_capture.train[:1])
    scene = train(alone, iterations=30).scene
    assert quality(scene, alone.train) > 20
    with pytest.raises(PocketGSError, match="stand in one place"):
        train(alone, iterations=30, recipe="reference")


def test_observer(small_capture: Capture) -> None:
    told: list[Progress] = []
    result = train(small_capture, iterations=12, evaluate_every=5, observer=told.append)
    assert [progress.iteration for progress in told] == list(range(1, 13))
    assert [progress.fraction for progress in told] == pytest.approx([number / 12 for number in range(1, 13)])
    assert all(progress.iterations == 12 and progress.gaussians == 2000 for progress in told)
    assert [progress.held_out_psnr is None for progress in told] == [True] * 4 + [False] * 8
    assert told[-1].loss < told[0].loss
    assert told[-1].seconds_left == 0
    assert [sample.iteration for sample in result.losses] == [5, 10]
    assert result.losses[1].held_out_psnr == told[-1].held_out_psnr
    assert {"seeding", "compilation", "training", "evaluation"} <= set(result.seconds)
    assert sum(result.engine_bytes.values()) > 0


def test_looks_at_held_out_views_change_nothing(small_capture: Capture) -> None:
    often, never = (train(small_capture, iterations=10, evaluate_every=every) for every in (1, 0))
    assert bits(often.scene) == bits(never.scene)
    assert never.losses == []


def test_looks_are_at_some_of_many_held_out_views(small_capture: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    """They are spread over all of them."""
    looked_at: list[list[str]] = []

    def listening(engine: CpuEngine, frames: Sequence[Frame], background: tuple[float, float, float]) -> float:
        looked_at.append([frame.name for frame in frames])
        return mean_psnr(engine, frames, background)

    monkeypatch.setattr(loop, "mean_psnr", listening)
    held_out = [replace(small_capture.held_out[0], name=f"{number:03}") for number in range(125)]
    many = replace(small_capture, held_out=held_out)
    result = train(many, iterations=10, evaluate_every=5)
    assert len(result.losses) == len(looked_at) == 2
    assert looked_at[0] == looked_at[1]
    assert len(looked_at[0]) == 12
    assert (looked_at[0][0], looked_at[0][-1]) == ("000", "124")


def test_resuming_from_a_checkpoint(small_capture: Capture) -> None:
    """Ctrl-C at iteration 10 of 20; the resumed run gives the same bits as an uninterrupted one."""
    checkpoints: list[Checkpoint] = []

    def press_ctrl_c(progress: Progress) -> None:
        if progress.iteration == 10:
            checkpoints.append(progress.checkpoint())
            signal.raise_signal(signal.SIGINT)

    handlers = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    options = TrainingOptions(iterations=20, sh_degree=1)
    stopped = train(small_capture, options, observer=press_ctrl_c)
    assert handlers == [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    assert (stopped.iterations, stopped.interrupted) == (10, True)
    (checkpoint,) = checkpoints
    assert (checkpoint.iteration, checkpoint.state.steps) == (10, 10)
    assert bits(checkpoint.gaussians) == bits(stopped.scene)
    resumed, whole = train(small_capture, options, resume=checkpoint), train(small_capture, options)
    assert bits(resumed.scene) == bits(whole.scene) != bits(stopped.scene)
    assert resumed.iterations == 20
    for name in ("first_moments", "second_moments"):
        one, other = (getattr(result.checkpoint.state, name) for result in (resumed, whole))
        assert one.tobytes() == other.tobytes()


def test_ctrl_c_after_the_last_step_keeps_the_scene(small_capture: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = train(small_capture, iterations=5)

    def download(engine: CpuEngine) -> Gaussians:
        signal.raise_signal(signal.SIGINT)
        return downloaded(engine)

    downloaded = CpuEngine.download
    monkeypatch.setattr(CpuEngine, "download", download)
    kept = train(small_capture, iterations=5)
    assert kept.interrupted is False
    assert bits(kept.scene) == bits(whole.scene)


def test_second_ctrl_c_stops_at_once(small_capture: Capture) -> None:
    def press_ctrl_c(progress: Progress) -> None:
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        train(small_capture, observer=press_ctrl_c)
    assert signal.getsignal(signal.SIGINT) == before


def test_training_in_another_thread(small_capture: Capture) -> None:
    """In a thread that cannot catch signals."""
    scenes: list[Gaussians] = []
    thread = threading.Thread(target=lambda: scenes.append(train(small_capture, iterations=5).scene))
    thread.start()
    thread.join(60)
    assert bits(scenes[0]) == bits(train(small_capture, iterations=5).scene)


def test_error_of_an_observer_reaches_the_caller(small_capture: Capture) -> None:
    def fail(progress: Progress) -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        train(small_capture, observer=fail)
