"""Runs within budgets, in separate processes, to measure their memory and time; refusals before any work."""

from __future__ import annotations

import json
import platform
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from missing import unavailable
from pocketgs.capture import list_capture
from pocketgs.errors import PocketGSError
from pocketgs.gpu.adapters import adapters
from pocketgs.results.run import run
from pocketgs.system import freed_memory
from pocketgs.system.compile import is_compiled
from pocketgs.training.options import TrainingOptions
from pocketgs.training.planning.machine import ENGINE_KERNELS, FEATURE_KERNELS, PRIOR_KERNELS
from real_runs.commands import succeeds

Run = Callable[..., dict[str, Any]]


@pytest.fixture
def trained(tmp_path: Path) -> Run:
    """A function that trains on a capture with some options, and returns the run's record."""

    def train(capture: Path, *options: object) -> dict[str, Any]:
        output = succeeds("train", capture, "--output", tmp_path / "result", *options)
        return {**json.loads((tmp_path / "result" / "run.json").read_text()), "output": output}

    return train


@pytest.fixture
def _compiled(trained: Run, written_capture: Path) -> None:
    """Compile kernels first, so that measured runs do not."""
    if not all(map(is_compiled, (ENGINE_KERNELS, FEATURE_KERNELS, *PRIOR_KERNELS))):
        trained(written_capture, "--iterations", 1, "--engine", "cpu")


@pytest.mark.usefixtures("_compiled")
@pytest.mark.parametrize(("engine", "budget"), [("cpu", 520), ("webgpu", 700)])
def test_a_run_keeps_to_its_memory(trained: Run, written_capture: Path, engine: str, budget: int) -> None:
    if engine == "webgpu" and not adapters():
        unavailable("no device with WebGPU")
    few = ("--iterations", 5, "--max-keyframes", 3)
    record = trained(written_capture, "--max-memory", budget, *few, "--engine", engine)
    plan, actual = record["plan"], record["plan"]["actual"]
    assert actual["peak_rss_mb"] == pytest.approx(record["peak_rss_mb"], rel=0.01)
    assert 100 < actual["peak_rss_mb"] <= plan["peak_rss_mb"] <= budget
    assert actual["device_mb"] <= plan["device_mb"] <= budget
    assert (actual["device_mb"] > 0) == (engine == "webgpu")
    assert actual["gaussians"] <= plan["gaussians"]
    assert plan["seconds"] is None
    assert f"up to {plan['peak_rss_mb']:.0f} MB of memory" in record["output"]


@pytest.mark.slow
@pytest.mark.usefixtures("_compiled")
@pytest.mark.parametrize("budget", [480, 700])
def test_real_captures_keep_to_little_memory(trained: Run, data_folder: Path, budget: int) -> None:
    """Memory is saved by smaller photographs, or, if their size is given, by fewer Gaussians."""
    few = ("--iterations", 10, "--max-keyframes", 3)
    record = trained(data_folder / "fern", "--images", "images_8", "--max-memory", budget, *few)
    plan = record["plan"]
    assert record["peak_rss_mb"] <= plan["peak_rss_mb"] <= budget
    assert (f"warning: to keep to {budget:,} MB" in record["output"]) == (
        plan["shrink"] > 1 or plan["gaussians"] < record["options"]["max_gaussians"]
    )
    assert (plan["shrink"] > 1) == (budget == 480)
    assert f"{plan['width']}x{plan['height']}" in record["protocol"]


@pytest.mark.slow
@pytest.mark.usefixtures("_compiled")
def test_a_run_that_was_made_smaller_goes_on_at_its_size(trained: Run, data_folder: Path) -> None:
    command = [data_folder / "fern", "--images", "images_8", "--prior", "none", "--engine", "cpu"]
    first = trained(*command, "--max-memory", 320, "--iterations", 5)
    assert first["plan"]["shrink"] > 1
    second = trained(*command, "--iterations", 8, "--resume")
    assert (second["resumed_from"], second["iterations"]) == (5, 8)
    assert second["protocol"] == first["protocol"]
    assert second["gaussians"] == first["gaussians"]
    assert second["plan"]["gaussians"] == first["plan"]["gaussians"]


@pytest.mark.usefixtures("_compiled")
def test_a_run_keeps_to_its_time(trained: Run, written_capture: Path) -> None:
    """With an unlimited number of iterations; twice the time is allowed, since the machine may be busy."""
    record = trained(written_capture, "--time-budget", 15, "--iterations", 10**6, "--prior", "none", "--engine", "cpu")
    plan = record["plan"]
    assert plan["iterations"] < 10**6
    assert plan["seconds"] <= 15
    assert plan["reserve"] > 0
    assert 1 <= record["iterations"] < 10**6
    assert record["interrupted"] is False
    assert record["seconds"]["total"] < 30
    assert record["options"]["time_budget"] == 15


@pytest.mark.parametrize(
    ("budget", "refusal"),
    [
        ({"max_memory": 20}, "max memory: found 20 MB, but even with photographs of 96x72"),
        ({"time_budget": 0.5, "max_memory": 10_000}, "time budget: found 0.5 s, but even with photographs of 96x72"),
    ],
)
def test_too_small_a_budget_is_refused_before_anything_is_decoded(
    written_capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, budget: dict[str, Any], refusal: str
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise AssertionError("work has begun")

    monkeypatch.setattr("pocketgs.capture.listed.load_frames", fail)
    monkeypatch.setattr("pocketgs.results.run.prepare", fail)
    with pytest.raises(PocketGSError, match=refusal):
        run(lambda: list_capture(written_capture), tmp_path / "out", TrainingOptions(engine="cpu", **budget))
    assert not (tmp_path / "out").exists()


def test_a_planned_size_is_what_is_read(trained: Run, written_capture: Path, tmp_path: Path) -> None:
    record = trained(written_capture, "--iterations", 1, "--prior", "none", "--max-gaussians", 500)
    assert (record["plan"]["width"], record["plan"]["height"], record["plan"]["shrink"]) == (96, 72, 1)
    assert record["plan"]["gaussians"] == 500 >= record["gaussians"]


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other C libraries keep nothing")
def test_freed_memory_is_given_back() -> None:
    process = psutil.Process()
    pieces = [np.ones(1000) for _ in range(10_000)]
    last = pieces[-1]
    before = process.memory_info().rss
    del pieces
    freed_memory.give_back()
    assert process.memory_info().rss < before - 40_000_000
    assert last.sum() == 1000


def test_rooms_without_machine_code_are_known() -> None:
    assert not is_compiled("nowhere")
