"""A table continues where it stopped, and contains results under the same conditions only."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path
from typing import Any

import pytest

from benchmark.toy_jobs import QUICK, job, result_of
from pocketgs.benchmark import session
from pocketgs.benchmark.captures import BenchCapture
from pocketgs.benchmark.cell import Job
from pocketgs.benchmark.conditions import present_conditions
from pocketgs.benchmark.methods import METHODS
from pocketgs.benchmark.results import Cell, CellResult, read_results, write_result
from pocketgs.capture import Capture
from pocketgs.errors import PocketGSError
from pocketgs.training.options import TrainingOptions
from pocketgs.training.preparation import prepare


def test_what_has_a_result_is_not_run_again(tmp_path: Path) -> None:
    jobs = [job(tmp_path, seed=seed) for seed in range(6)]
    first, second, third, fourth, fifth, sixth = map(result_of, jobs)
    results = [
        first,
        replace(second, command="pocketgs train elsewhere"),
        replace(third, error="no memory"),
        replace(fourth, sources="0123456789abcdef"),
        replace(fifth, machine={"processor": "Abacus 9"}),
        replace(sixth, settings="--iterations 7"),
    ]
    assert session.remaining(jobs, results, present_conditions(QUICK)) == jobs[1:]


def test_another_capture_of_the_same_name_has_no_result(capture_folder: Path, tmp_path: Path) -> None:
    """Nor has one whose photographs were replaced."""
    other = Path(shutil.copytree(capture_folder, tmp_path / "other" / "toys"))
    first, second = job(capture_folder), job(other)
    done = [result_of(first)]
    conditions = present_conditions(QUICK)
    assert session.remaining([second], done, conditions) == []
    (other / "images" / "0003.png").write_bytes(b"another photograph")
    second = job(other)
    assert session.remaining([second], done, conditions) == [second]
    assert session.comparable(done, [second], conditions) == []
    assert session.comparable(done, [first], conditions) == done
    # Nor are the two put into the table of others.
    both = [*done, result_of(replace(second, seed=1))]
    assert session.comparable(both, [job(tmp_path / "fern")], conditions) == []
    for result in (*done, result_of(second)):
        write_result(tmp_path / "results", result)
    assert len(read_results(tmp_path / "results")) == 2


def test_hidden_files_are_no_part_of_a_capture(capture_folder: Path) -> None:
    before = job(capture_folder).capture.files
    (capture_folder / ".DS_Store").write_text("where the icons are")
    assert job(capture_folder).capture.files == before
    (capture_folder / "images" / "0003.png").rename(capture_folder / "images" / "0033.png")
    assert job(capture_folder).capture.files != before


def test_a_table_is_of_runs_under_the_same_conditions(tmp_path: Path) -> None:
    asked = job(tmp_path / "fern")
    alike = [
        result_of(asked),
        result_of(job(tmp_path / "fern", "no-dense", 7)),
        result_of(job(tmp_path / "garden", "3dgs-sfm", 3)),
        result_of(job(tmp_path / "fern", seed=1), error="no memory"),
    ]
    others = [
        result_of(job(tmp_path / "fern", seed=2, flags=("--iterations", "7"))),
        replace(result_of(job(tmp_path / "fern", seed=3)), sources="0123456789abcdef"),
        replace(result_of(job(tmp_path / "garden", seed=4)), machine={}),
        replace(result_of(job(tmp_path / "fern", seed=5)), command="pocketgs train fern --downscale 8"),
        replace(result_of(asked), cell=Cell("fern", "magic", 6)),
    ]
    results = [result for pair in zip_longest(others, alike) for result in pair if result]
    assert session.comparable(results, [asked], present_conditions(QUICK)) == alike


def test_time_left_comes_from_the_most_alike_results(tmp_path: Path) -> None:
    fast, slow = job(tmp_path, "3dgs-sfm"), job(tmp_path, "pocketgs")
    elsewhere = job(tmp_path / "elsewhere", "pocketgs")
    assert session.seconds_left([fast], []) is None
    assert session.seconds_left([fast], [result_of(elsewhere, 40.0)]) == session.OVERHEAD * 40
    done = [result_of(fast, 8.0), result_of(slow, 24.0), result_of(elsewhere, 100.0)]
    assert session.seconds_left([fast, fast, slow], done) == session.OVERHEAD * 40
    assert session.seconds_left([job(tmp_path, "no-dense")], done) == session.OVERHEAD * 16


def test_a_failed_cell_does_not_lose_the_others(
    written_capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(cell: Job, work: Path) -> CellResult:
        return result_of(cell, error="broken" if cell.seed == 1 else None)

    monkeypatch.setattr(session, "run_cell", run)
    told: list[Cell] = []
    jobs = [job(written_capture, seed=seed) for seed in range(3)]
    session.run_jobs(jobs, tmp_path, tmp_path, lambda step: told.append(step.cell), lambda result: None)
    assert told == [cell.cell for cell in jobs]
    assert [result.error for result in read_results(tmp_path)] == [None, "broken", None]


@pytest.mark.parametrize(
    ("earlier", "kept"),
    [
        (lambda result: result, True),
        (lambda result: replace(result, error="no memory"), False),
        (lambda result: replace(result, command="pocketgs train elsewhere", error="no memory"), False),
    ],
)
def test_a_failure_replaces_only_failures(
    earlier: Callable[[CellResult], CellResult], kept: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    again = job(tmp_path / "fern")
    before, broken = earlier(result_of(again)), result_of(again, error="broken")
    write_result(tmp_path, before)
    monkeypatch.setattr(session, "run_cell", lambda cell, work: broken)
    found = session.run_jobs([again], tmp_path, tmp_path, lambda step: None, lambda result: None)
    assert found == [broken]
    assert read_results(tmp_path) == [before if kept else broken]


@pytest.mark.parametrize("error", [None, "broken"])
@pytest.mark.parametrize(
    "other",
    [{"command": "pocketgs train elsewhere"}, {"files": "another"}, {"settings": "--iterations 7"}, {"machine": {}}],
)
def test_results_of_other_conditions_stay(
    other: dict[str, Any], error: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each is replaced by its repetition only."""
    again = job(tmp_path / "fern")
    before, now = replace(result_of(again), **other), result_of(again, 20.0, error)
    write_result(tmp_path, before)
    monkeypatch.setattr(session, "run_cell", lambda cell, work: now)
    for _ in range(2):
        session.run_jobs([again], tmp_path, tmp_path, lambda step: None, lambda result: None)
        assert [result.wall_seconds for result in read_results(tmp_path)] == [20.0, 10.0]
    assert (tmp_path / "fern.pocketgs.0.json") == write_result(tmp_path, replace(before, wall_seconds=30.0))
    assert [result.wall_seconds for result in read_results(tmp_path)] == [20.0, 30.0]


def test_a_capture_read_in_two_ways_is_in_the_table_if_asked_for(tmp_path: Path) -> None:
    def of(downscale: str, method: str) -> Job:
        capture = BenchCapture("fern", tmp_path / "fern", flags=("--downscale", downscale))
        return Job(METHODS[method], capture, 0, QUICK)

    fox = job(tmp_path / "fox")
    halves = [result_of(of("2", method)) for method in ("pocketgs", "no-seeding")]
    results = [*halves, result_of(of("4", "pocketgs")), result_of(fox)]
    conditions = present_conditions(QUICK)
    assert session.comparable(results, [fox], conditions) == [results[3]]
    assert session.comparable([*halves, results[3]], [fox], conditions) == [*halves, results[3]]
    assert session.comparable(results, [of("2", "no-dense")], conditions) == [*halves, results[3]]


def test_what_the_benchmark_writes_into_a_capture_is_no_part_of_it(capture_folder: Path, tmp_path: Path) -> None:
    """But a capture inside such a folder is one."""
    work, outside = capture_folder / "output" / "bench", tmp_path
    before = BenchCapture("toys", capture_folder).files
    assert BenchCapture("toys", capture_folder, written=(work, outside)).files == before
    work.mkdir(parents=True)
    (work / "toys.pocketgs.0.log").write_text("iteration 1")
    assert BenchCapture("toys", capture_folder, written=(work, outside)).files == before
    assert BenchCapture("toys", capture_folder).files != before


def test_a_negative_seed_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PocketGSError, match="seed: found -1, expected at least 0"):
        session.plan_jobs([METHODS["pocketgs"]], [BenchCapture("toys", tmp_path)], (0, -1), ())


def test_a_seed_named_twice_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PocketGSError, match="seed 0: named twice"):
        session.plan_jobs([METHODS["pocketgs"]], [BenchCapture("fern", tmp_path)], (0, 1, 0), ())


def test_compiling_covers_what_refines_poses(monkeypatch: pytest.MonkeyPatch) -> None:
    trained: list[tuple[Capture, TrainingOptions]] = []
    monkeypatch.setattr(session, "train", lambda capture, options: trained.append((capture, options)))
    session.compile_kernels()
    ((capture, options),) = trained
    report = prepare(capture, options).report
    assert report is not None
    assert report.poses_refined
    assert len(report.poses.carried) < len(capture.frames) - sum(decision.kept for decision in report.decisions)


def test_the_first_seed_of_everything_comes_first(tmp_path: Path) -> None:
    captures = [BenchCapture(name, tmp_path / name) for name in ("fern", "fox")]
    jobs = session.plan_jobs([METHODS["pocketgs"], METHODS["3dgs-mvs"]], captures, (0, 1), ())
    assert [(entry.seed, entry.capture.name, entry.method.name) for entry in jobs] == [
        (seed, capture, method) for seed in (0, 1) for capture in ("fern", "fox") for method in ("pocketgs", "3dgs-mvs")
    ]
