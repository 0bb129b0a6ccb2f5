"""`pocketgs bench`: the cells it runs and skips, the files it writes, and its exit."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import psutil
import pytest

from benchmark.toy_jobs import COMMON, ON_POSIX, job, result_of, wait_for
from pocketgs.benchmark import session
from pocketgs.benchmark.captures import DEMO, BenchCapture
from pocketgs.benchmark.cell import Job
from pocketgs.benchmark.methods import METHODS
from pocketgs.benchmark.results import Cell, CellResult, read_results, write_result
from pocketgs.cli import main

command = import_module("pocketgs.cli.commands.bench")
"""The module; the package has a function of that name."""


def bench_arguments(capture: Path, folder: Path, *more: str) -> list[str]:
    return [
        "bench",
        "--captures",
        str(capture),
        *COMMON,
        "--output",
        str(folder),
        "--work",
        str(folder / "work"),
        *more,
    ]


def test_the_command_writes_results_table_and_report_and_goes_on_where_it_stopped(
    written_capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "compile_kernels", lambda: None)  # other tests of this session have
    main(bench_arguments(written_capture, tmp_path, "--methods", "pocketgs", "no-seeding"))
    names = {path.name for path in tmp_path.iterdir()}
    written = {"results.md", "overview.png", "report.html", "work"}
    assert names == {"toys.pocketgs.0.json", "toys.no-seeding.0.json", *written}
    first, second = read_results(tmp_path)
    for result in (first, second):
        assert f"{result.run['psnr']:.2f}" in (tmp_path / "results.md").read_text()
        assert f"{result.run['psnr']:.2f}" in (tmp_path / "report.html").read_text()

    def refuse(cell: Job, work: Path) -> CellResult:
        raise AssertionError("nothing is left to run")

    monkeypatch.setattr(session, "run_cell", refuse)
    write_result(tmp_path, replace(second, cell=Cell("toys", "no-dense", 0), sources="0123456789abcdef"))
    capsys.readouterr()
    main(bench_arguments(written_capture, tmp_path, "--methods", "pocketgs", "no-seeding"))
    said = capsys.readouterr().out
    assert "2 cells, 2 of them done before" in said
    assert "1 results of other captures, versions, machines or settings are left out" in said
    assert "no-dense" not in (tmp_path / "results.md").read_text()


def test_failed_cells_end_the_command_with_2_and_their_names(
    capture_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "compile_kernels", lambda: None)  # other tests of this session have
    (capture_folder / "transforms.json").write_text("{")
    with pytest.raises(SystemExit) as ended:
        main(bench_arguments(capture_folder, tmp_path, "--methods", "pocketgs"))
    assert ended.value.code == 2
    assert "1 of 1 cells failed: toys.pocketgs.0" in capsys.readouterr().err
    assert "transforms.json" in (tmp_path / "results.md").read_text()


def test_common_flags_are_checked_before_any_cell(
    written_capture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main([*bench_arguments(written_capture, tmp_path), "--iterations", "0"])
    assert ended.value.code == 2
    assert "iterations: found 0" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_another_report_is_not_replaced(
    written_capture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "report.html").write_text("quarterly figures")
    with pytest.raises(SystemExit) as ended:
        main(bench_arguments(written_capture, tmp_path))
    assert ended.value.code == 2
    assert "report.html: stands in a folder without results, expected another --output" in capsys.readouterr().err


def test_places_that_cannot_be_written_are_known_before_any_cell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "compile_kernels", lambda: pytest.fail("the work has begun"))
    (tmp_path / "toys").mkdir()
    (tmp_path / "work").write_text("a file")
    with pytest.raises(SystemExit) as ended:
        main(bench_arguments(tmp_path / "toys", tmp_path, "--methods", "pocketgs"))
    assert ended.value.code == 2
    assert "work: cannot be made (File exists)" in capsys.readouterr().err


@pytest.mark.parametrize("ends", [KeyboardInterrupt, RuntimeError])
def test_a_report_that_fails_does_not_hide_what_ended_the_runs(
    ends: type[BaseException],
    written_capture: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def end(*_: object) -> None:
        raise ends

    def fail(*_: object) -> None:
        raise ValueError("no ink")

    monkeypatch.setattr(command, "compile_kernels", end)
    monkeypatch.setattr(command, "write_report", fail)
    write_result(tmp_path, result_of(job(written_capture, seed=7, flags=COMMON)))
    with pytest.raises(SystemExit if ends is KeyboardInterrupt else ends) as ended:
        main(bench_arguments(written_capture, tmp_path, "--methods", "pocketgs"))
    assert ends is not KeyboardInterrupt or ended.value.code == 130
    assert "no report: no ink" in capsys.readouterr().out


def test_the_demo_is_filmed_only_for_cells_that_are_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    filmed: list[Path] = []
    monkeypatch.setattr(command, "compile_kernels", lambda: None)
    monkeypatch.setattr(command, "write_demo", filmed.append)
    monkeypatch.setattr(command, "run_jobs", lambda *_: [])
    (tmp_path / "toys").mkdir()
    arguments = [*bench_arguments(tmp_path / "toys", tmp_path, "--methods", "pocketgs"), "--demo", "elsewhere/film"]
    arguments.insert(2, DEMO)
    write_result(tmp_path, result_of(Job(METHODS["pocketgs"], BenchCapture(DEMO, Path("film")), 0, COMMON)))
    main(arguments)
    assert "2 cells, 1 of them done before" in capsys.readouterr().out
    assert filmed == []
    main([*arguments, "--seeds", "1"])
    assert filmed == [Path("elsewhere/film")]


@ON_POSIX
def test_ctrl_c_ends_the_cell_and_keeps_the_others(written_capture: Path, tmp_path: Path) -> None:
    write_result(tmp_path, result_of(job(written_capture, seed=7)))
    shutil.copy(tmp_path / "toys.pocketgs.7.json", tmp_path / "before")
    arguments = bench_arguments(written_capture, tmp_path, "--methods", "pocketgs")
    arguments[arguments.index("--iterations") + 1] = "1000000"
    program = [sys.executable, "-m", "pocketgs", *arguments]
    with subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        wait_for("iteration", tmp_path / "work" / "toys.pocketgs.0.log")
        cells = psutil.Process(process.pid).children()
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=120)
    assert process.returncode == 130, errors.decode()
    assert len(cells) == 1
    assert not cells[0].is_running()
    assert (tmp_path / "toys.pocketgs.7.json").read_bytes() == (tmp_path / "before").read_bytes()
    assert not (tmp_path / "toys.pocketgs.0.json").exists()
