"""What was trained survives a failure after training; and checkpoints take time of the budget."""

from __future__ import annotations

import errno
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from conftest import write_nerfstudio
from pocketgs.capture import Capture
from pocketgs.capture.open import list_capture
from pocketgs.errors import PocketGSError
from pocketgs.metrics import evaluation
from pocketgs.results import checkpoint
from pocketgs.results import run as run_module
from pocketgs.results.folder import FILES
from pocketgs.results.reporter import Reporter
from pocketgs.results.run import run
from pocketgs.scene.gaussians import Gaussians
from pocketgs.training.options import SizedOptions, TrainingOptions
from pocketgs.training.planning.calibration import Speed
from pocketgs.training.planning.plan import Plan


@pytest.fixture
def train(small_capture: Capture, tmp_path: Path) -> Callable[[int], Any]:
    """Runs a number of iterations, with the result in "out"."""
    write_nerfstudio(small_capture, tmp_path / "room")

    def command(iterations: int) -> Any:
        options = TrainingOptions(iterations=iterations, prior="none", evaluate_every=0)
        return run(lambda: list_capture(tmp_path / "room"), tmp_path / "out", options)

    return command


def fail(monkeypatch: pytest.MonkeyPatch, where: str) -> str:
    """Let a step after training fail; the error as it is reported."""

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    def out_of_memory(*_: object, **__: object) -> None:
        raise MemoryError("no room for a rendering")

    if where == "pictures":
        monkeypatch.setattr(Image.Image, "save", full)
        return "out: the result cannot be written .No space left on device."
    if where == "checkpoint":
        monkeypatch.setattr(run_module, "write_checkpoint", full)
        return "out: the result cannot be written .No space left on device."
    monkeypatch.setattr(evaluation, "psnr", out_of_memory)
    return "no room for a rendering"


@pytest.mark.parametrize("where", ["pictures", "checkpoint", "evaluation"])
def test_failure_after_training_keeps_the_scene_and_the_earlier_result(
    train: Callable[[int], Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    contents: Callable[[Path], dict[str, bytes]],
    where: str,
) -> None:
    train(2)
    before = contents(tmp_path / "out")
    with monkeypatch.context() as patch:
        message = fail(patch, where)
        with pytest.raises(PocketGSError, match=rf"{message}.*; scene\.ply is kept in .*unpublished-"):
            train(4)
    (kept,) = (tmp_path / "out").glob("unpublished-*")
    assert len(Gaussians.load(kept / "scene.ply")) == 2000
    assert (kept / "scene.ply").read_bytes() != before["scene.ply"]
    after = contents(tmp_path / "out")
    assert {name: after.get(name) for name in before} == before
    assert not list((tmp_path / "out" / ".pocketgs").glob("staging-*"))
    assert train(4).scene  # the folder can be used again


def test_failure_of_a_first_run_keeps_the_scene(
    train: Callable[[int], Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fail(monkeypatch, "evaluation")
    with pytest.raises(PocketGSError, match=r"scene\.ply is kept in"):
        train(2)
    (kept,) = (tmp_path / "out").glob("unpublished-*")
    assert {path.name for path in kept.iterdir()} >= {*FILES} - {"run.json"}


def test_ctrl_c_twice_during_evaluation_keeps_the_scene(
    train: Callable[[int], Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(evaluation, "psnr", interrupt)
    with pytest.raises(KeyboardInterrupt, match=r"scene\.ply is kept in .*unpublished-"):
        train(2)
    assert len(list((tmp_path / "out").glob("unpublished-*/scene.ply"))) == 1


def test_ctrl_c_during_evaluation_is_remembered(train: Callable[[int], Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """The result is complete, but whoever wants more of the run knows."""
    assert not train(2).stopped
    measure = evaluation.psnr

    def interrupted(*given: Any) -> Any:
        signal.raise_signal(signal.SIGINT)
        monkeypatch.setattr(evaluation, "psnr", measure)
        return measure(*given)

    monkeypatch.setattr(evaluation, "psnr", interrupted)
    result = train(2)
    assert result.stopped
    assert not result.summary["interrupted"]


def test_time_for_checkpoints_is_part_of_the_time_budget(
    train: Callable[[int], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    write = checkpoint.write_checkpoint

    def slow(*of: Any) -> None:
        time.sleep(0.1)
        write(*of)

    monkeypatch.setattr(checkpoint, "write_checkpoint", slow)
    for interval in ("SECONDS_BETWEEN_CHECKPOINTS", "PAUSE"):
        monkeypatch.setattr(checkpoint, interval, 0.0)
    monkeypatch.setattr(run_module, "_seconds_left", lambda *_: 1.0)
    assert 1 <= train(40).summary["iterations"] <= 10


def planned_and_asked(
    capture: Capture, folder: Path, monkeypatch: pytest.MonkeyPatch, started: float, **options: Any
) -> tuple[Plan, SizedOptions]:
    """The plan of a run with a time budget, and what training is asked for, `started` seconds after the start."""
    asked: list[SizedOptions] = []
    plans: list[Plan] = []

    def stop(_: Capture, options: SizedOptions, **__: object) -> None:
        asked.append(options)
        raise KeyboardInterrupt

    monkeypatch.setattr(run_module, "train", stop)
    monkeypatch.setattr(run_module, "measure_speed", lambda *_: Speed(1.0, 1.0, 1.0))
    monkeypatch.setattr(run_module, "seconds_since_start", lambda: started)
    write_nerfstudio(capture, folder / "room")
    given = TrainingOptions(time_budget=20.0, prior="none", engine="cpu", **options)
    with pytest.raises(KeyboardInterrupt):
        run(lambda: list_capture(folder / "room"), folder / "out", given, reporter=Reporter(on_plan=plans.append))
    return plans[0], asked[0]


def test_training_knows_how_many_iterations_the_budget_is_planned_for(
    small_capture: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan, asked = planned_and_asked(small_capture, tmp_path, monkeypatch, 1.0, iterations=1_000_000)
    assert 50 <= plan.iterations < 1_000_000
    assert asked.expected_iterations == plan.iterations
    assert asked.iterations == 1_000_000


def test_training_leaves_time_to_evaluate_and_to_write(
    small_capture: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan, asked = planned_and_asked(small_capture, tmp_path, monkeypatch, 3.0)
    assert plan.reserve is not None
    assert plan.reserve > 0.1
    assert asked.time_budget == pytest.approx(20.0 - 3.0 - plan.reserve)
