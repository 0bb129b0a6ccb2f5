"""Open-ended training: runs that continue as long as the validation PSNR improves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from conftest import write_nerfstudio
from pocketgs.capture.capture import Capture
from pocketgs.capture.open import list_capture
from pocketgs.capture.synthetic import true_capture
from pocketgs.errors import PocketGSError
from pocketgs.results.checkpoint import CHECKPOINT, read_checkpoint, write_checkpoint
from pocketgs.results.run import run as run_command
from pocketgs.scene.gaussians import PARAMETERS
from pocketgs.seeding.seeds import seed_balls
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.settings import LearningRates
from pocketgs.training import open_ended
from pocketgs.training.open_ended import MIN_GAIN, OpenEndedPace, stages
from pocketgs.training.options import TrainingOptions
from pocketgs.training.planning import effort
from pocketgs.training.planning.effort import sized
from pocketgs.training.progress import Progress
from pocketgs.training.result import Checkpoint
from pocketgs.training.train import train
from pocketgs.training.transients import Transients
from pocketgs.training.validation import ValidationHistory, ValidationSample, mean_psnr, validation_views

RATES = LearningRates(1.0, 1.0, 1.0, 1.0, 1.0, 1.0)


class Seen:
    """An engine with a number of Gaussians, and nothing else."""

    count = 100


@pytest.fixture
def psnrs(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The next values of the validation PSNR."""
    values: list[float] = []
    monkeypatch.setattr(open_ended, "mean_psnr", lambda *_: values.pop(0))
    return values


def pace(
    seconds: float | None = None, longest: int = 20_000, history: ValidationHistory | None = None, least: int = 0
) -> OpenEndedPace:
    frames: Any = [None] * 40
    return OpenEndedPace(least, longest, seconds, RATES, frames, (0.0, 0.0, 0.0), 1000, history)


def run(found: OpenEndedPace, seconds_per_step: float = 0.0) -> int:
    """Number of iterations until the run ends."""
    engine: Any = Seen()
    iteration = 0
    while found.fraction(iteration, iteration * seconds_per_step) < 1.0:
        iteration += 1
        found.after_step(iteration, iteration * seconds_per_step, engine)
    return iteration


def test_every_stage_adds_a_third() -> None:
    assert stages(2000) == [500, 667, 889, 1185, 1580, 2000]
    assert stages(300) == [300]


@pytest.mark.parametrize("views", range(60))
def test_validation_views_are_few_and_spread(views: int) -> None:
    found = validation_views(views)
    assert found == sorted(set(found))
    assert len(found) == 0 or 2 <= len(found) <= 12
    assert len(found) <= views / 6
    assert all(0 <= index < views for index in found)


def test_it_ends_when_two_stages_gain_too_little(psnrs: list[float]) -> None:
    psnrs += [20.0, 21.0, 21.0 + 0.9 * MIN_GAIN, 20.9]
    found = pace()
    assert run(found) == round(1185 * 1.5)
    assert found.history.decays_from == 1185
    assert [sample.iteration for sample in found.history.samples] == [500, 667, 889, 1185]


def test_one_worse_stage_does_not_end_it(psnrs: list[float]) -> None:
    psnrs += [20.0, 21.0, 20.5, 21.0 + 1.1 * MIN_GAIN, 20.6, 20.7]
    assert run(pace()) == round(2107 * 1.5)


def test_it_is_not_shorter_than_a_run_of_given_length(psnrs: list[float]) -> None:
    """The first stages of a capture with many views tell little."""
    psnrs += [20.0, 19.9, 19.8, 19.7, 19.6]
    found = pace(least=1700)
    assert found.iterations == round(1185 * 1.5)
    assert run(found) == round(1185 * 1.5)
    psnrs += [20.0, 19.9]
    assert run(pace(least=1700, seconds=90.0), seconds_per_step=0.1) == 900


def test_it_goes_on_while_it_pays(psnrs: list[float]) -> None:
    psnrs += [20.0 + 0.1 * i for i in range(20)]
    assert run(pace(longest=3000)) == 3000


def test_a_diverged_scene_is_no_number(capture: Capture) -> None:
    assert capture.points is not None
    engine = CpuEngine()
    engine.upload(seed_balls(capture.points, 0.5, 0))
    black = (0.0, 0.0, 0.0)
    assert 5.0 < mean_psnr(engine, capture.train[:2], black) < 50.0
    render = engine.render
    engine.render = lambda *of: replace(render(*of), image=np.full((36, 48, 3), np.nan, np.float32))  # type: ignore
    assert np.isnan(mean_psnr(engine, capture.train[:2], black))


def test_diverged_views_end_it(psnrs: list[float]) -> None:
    psnrs += [20.0, float("nan")]
    assert run(pace()) == 1000


def test_a_time_budget_leaves_a_third_for_the_end(psnrs: list[float]) -> None:
    psnrs += [20.0 + i for i in range(20)]
    found = pace(seconds=90.0)
    steps = run(found, seconds_per_step=0.1)
    assert found.history.decays_from == 600
    assert steps == 900
    assert found.rates(899, 89.9).means < 0.05 * found.rates(600, 60.0).means


def test_rates_fall_slowly_and_at_last_to_the_end(psnrs: list[float]) -> None:
    found = pace()
    assert found.rates(500, 0.0) == RATES
    assert found.rates(2000, 0.0).means == pytest.approx(0.5)
    ended = pace(history=ValidationHistory((), 2000))
    rates = [ended.rates(iteration, 0.0).means for iteration in range(2000, 3000)]
    assert rates[0] == pytest.approx(0.5)
    assert rates[-1] == pytest.approx(0.01, rel=0.01)
    assert np.all(np.diff(rates) <= 0.0)


def test_validation_views_are_trained_on_at_the_end() -> None:
    assert set(pace().views(0)) == set(range(40)) - set(validation_views(40))
    assert list(pace(history=ValidationHistory((), 500)).views(600)) == list(range(40))


def test_a_view_that_is_dropped_after_the_listing_leaves_validation_views() -> None:
    assert sized(TrainingOptions(effort="best"), [(498, 372)] * 13).open_ended
    for views in (12, 11, 6):
        frames: Any = [None] * views
        found = OpenEndedPace(0, 20_000, None, RATES, frames, (0.0, 0.0, 0.0), 1000, None)
        assert len(found.views(0)) == views - 2


def test_too_few_views_for_validation_train_as_long_as_a_run_of_given_length() -> None:
    """Most views may be masked whole."""
    frames: Any = [None] * 5
    found = OpenEndedPace(1000, 3000, None, RATES, frames, (0.0, 0.0, 0.0), 1000, None)
    assert len(found.views(0)) == 5
    assert found.next_growth(1) == 500
    assert run(found) == found.iterations == 1000
    assert found.history.samples == ()


def test_a_resumed_run_counts_its_time_from_the_last_look(psnrs: list[float]) -> None:
    """So that the gain per minute is that of training, not of the time since it was resumed."""
    psnrs.append(20.5)
    found = pace(history=ValidationHistory((ValidationSample(500, 20.0, 100, 90.0),)))
    engine: Any = Seen()
    found.after_step(667, 30.0, engine)
    assert found.history.samples[-1] == ValidationSample(667, 20.5, 100, 120.0)
    assert found.history.gain_per_minute == pytest.approx(1.0)


def test_growth_follows_stages_that_pay() -> None:
    found = pace(
        history=ValidationHistory((ValidationSample(500, 20.0, 100, 1.0), ValidationSample(667, 21.0, 125, 61.0)))
    )
    assert found.history.gain_per_minute == pytest.approx(1.0)
    assert found.next_growth(668) == found.next_growth(889) == 889
    assert found.target(889, 400) == 500
    assert found.target(889, 900) == 1000
    assert pace(history=ValidationHistory((), 889)).next_growth(889) is None


def test_best_sizes_a_run_by_its_capture() -> None:
    views = [(498, 372)] * 17
    standard, best = (sized(TrainingOptions(effort=effort), views) for effort in ("standard", "best"))
    assert best.open_ended
    assert best.recipe == "long"
    assert best.strategy == "budgeted"
    assert best.max_gaussians == 2 * standard.max_gaussians
    assert best.most_at_start == standard.max_gaussians
    assert best.least_iterations >= 500
    assert not standard.open_ended
    assert standard.recipe == "pocketgs"
    # Too few views to hold any back, or a length that the user gives.
    assert not sized(TrainingOptions(effort="best"), views[:12]).open_ended
    longer = sized(TrainingOptions(effort="best", iterations=2000), views)
    assert (longer.open_ended, longer.max_gaussians) == (False, best.max_gaussians)  # so that it may go on from `best`
    given = sized(TrainingOptions(effort="best", iterations=700, max_gaussians=900), views)
    assert (given.open_ended, given.iterations, given.max_gaussians) == (False, 700, 900)


@pytest.fixture(scope="module")
def capture() -> Capture:
    """Sixteen training views; two of them are validation views."""
    return true_capture(width=48, height=36, frames=18, points=500)


def test_a_whole_run(capture: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The run evaluates, grows and ends, and a resumed one ends with the same bits."""
    monkeypatch.setattr(effort, "MIN_ITERATIONS", 30)
    monkeypatch.setattr(effort, "MAX_EPOCHS", 1)
    monkeypatch.setattr(open_ended, "FIRST_STAGE", 20)
    monkeypatch.setattr(open_ended, "SLOWS_FROM", 25)
    options = TrainingOptions(recipe="long", prior="none", max_gaussians=800, evaluate_every=0, colours="on")
    checkpoints: list[Checkpoint] = []
    promised: list[int] = []

    def watch(progress: Progress) -> None:
        promised.append(progress.iterations)
        history = progress.checkpoint().history
        assert history is not None
        # While it explores, and while rates decay.
        if progress.iteration == 30 or (len(checkpoints) == 1 and history.decays_from is not None):
            checkpoints.append(progress.checkpoint())

    whole = train(capture, options, observer=watch)
    history = whole.checkpoint.history
    assert history is not None
    assert history.decays_from is not None
    assert [sample.iteration for sample in history.samples[:3]] == [20, 27, 36]
    assert history.samples[1].gaussians > history.samples[0].gaussians
    assert promised[0] == 30
    assert promised[-1] == whole.iterations == round(1.5 * history.decays_from)
    assert len(checkpoints) == 2
    for checkpoint in checkpoints:
        write_checkpoint(tmp_path / CHECKPOINT, checkpoint, {})
        resumed = train(capture, options, resume=read_checkpoint(tmp_path, {}))
        for part in PARAMETERS:
            assert getattr(resumed.scene, part).tobytes() == getattr(whole.scene, part).tobytes(), part
        again = resumed.checkpoint.history
        assert again is not None
        clocks = [[replace(sample, seconds=0.0) for sample in each.samples] for each in (again, history)]
        assert clocks[0] == clocks[1]


def test_validation_views_are_judged_once_they_are_familiar(capture: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    """A view is only called a transient's after the scene was trained on it twice."""
    monkeypatch.setattr(effort, "MIN_ITERATIONS", 150)
    monkeypatch.setattr(effort, "MAX_EPOCHS", 1)
    monkeypatch.setattr(open_ended, "FIRST_STAGE", 100)
    visits = [0] * len(capture.train)
    judged: list[set[int]] = []
    step = CpuEngine.step

    def count(engine: CpuEngine, view: int, settings: Any) -> None:
        visits[view] += 1
        step(engine, view, settings)

    def judge(_: Transients, iteration: int, __: CpuEngine, trained: Sequence[int]) -> None:
        judged.append(set(trained))
        assert iteration < 40 or min(visits[view] for view in trained) >= 2

    monkeypatch.setattr(CpuEngine, "step", count)
    monkeypatch.setattr(Transients, "after_step", judge)
    options = TrainingOptions(recipe="long", prior="none", max_gaussians=400, evaluate_every=0, transients="mask")
    train(capture, options, engine="cpu")
    assert judged[0] == set(range(len(visits))) - set(validation_views(len(visits)))
    assert judged[-1] == set(range(len(visits)))


def test_a_command_goes_on_from_a_finished_run_only_for_more(
    capture: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(effort, "MIN_ITERATIONS", 15)
    monkeypatch.setattr(effort, "MAX_EPOCHS", 1)
    monkeypatch.setattr(open_ended, "FIRST_STAGE", 10)
    write_nerfstudio(capture, tmp_path / "room")
    options = TrainingOptions(recipe="long", prior="none", bundle=False, evaluate_every=0)

    def command(options: TrainingOptions, resume: bool) -> dict[str, Any]:
        return run_command(lambda: list_capture(tmp_path / "room"), tmp_path / "out", options, resume=resume).summary

    summary = command(options, resume=False)
    decays_from = summary["validation"]["decays_from"]
    assert summary["iterations"] == round(1.5 * decays_from)
    assert [sample["iteration"] for sample in summary["validation"]["samples"]][-1] == decays_from
    with pytest.raises(PocketGSError, match=f"{summary['iterations']} iterations are already done"):
        command(options, resume=True)
    more = summary["iterations"] + 5
    assert command(replace(options, iterations=more), resume=True)["iterations"] == more


def test_masked_pixels_of_validation_views_do_not_count(small_capture: Capture) -> None:
    """What is masked, such as somebody who walks by, no scene can show."""
    engine, black = CpuEngine(), (0.0, 0.0, 0.0)
    train(small_capture, opened_engine=engine, prior="none", iterations=10, evaluate_every=0)
    frame = small_capture.train[0]
    mask = np.ones(frame.image.shape[:2], np.bool_)
    mask[:, 30:] = False
    masked, spoilt = (
        replace(frame, image=np.where(mask[..., None], frame.image, colour).astype(np.uint8), mask=mask)
        for colour in (frame.image, 255 - frame.image)
    )
    assert mean_psnr(engine, [spoilt], black) == pytest.approx(mean_psnr(engine, [masked], black))
