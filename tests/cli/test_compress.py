"""`pocketgs compress` and `pocketgs train --compress`."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest

from pocketgs.capture import Capture, open_capture
from pocketgs.cli import compressing_run
from pocketgs.cli.scene_file import as_trained_on
from pocketgs.compression import candidates
from pocketgs.compression.views import Views
from pocketgs.errors import PocketGSError
from pocketgs.results.checkpoint import CHECKPOINT, read_checkpoint, write_checkpoint
from pocketgs.results.reporter import Reporter
from pocketgs.results.run import RunResult
from pocketgs.scene.formats import read_scene
from pocketgs.scene.gaussians import Gaussians
from pocketgs.training.options import TrainingOptions


@pytest.fixture(autouse=True)
def _few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("TUNING_STEPS", "ROUNDING_STEPS", "PRUNING_STEPS", "STEPS"):
        monkeypatch.setattr(candidates, name, getattr(candidates, name) // 20)


def test_a_result_folder_and_its_capture(
    pocketgs: Callable[..., Any], result: Path, written_capture: Path, tmp_path: Path
) -> None:
    path, figures = tmp_path / "small.pgs", tmp_path / "figures.json"
    outcome = pocketgs("compress", result, written_capture, "--output", path, "--size", 0.01, "--json", figures)
    assert (outcome.status, outcome.errors) == (0, "")
    assert 0 < path.stat().st_size <= 10_000
    assert f"{len(read_scene(path)):,} Gaussians in {path}, {path.stat().st_size:,} bytes" in outcome.output
    rows = json.loads(figures.read_text())["figures"]
    assert [row["name"] for row in rows[:2]] == ["original", ".spz"]
    assert [row["megabytes"] for row in rows if row["name"] == ".pgs, written"] == [path.stat().st_size / 1e6]
    assert all(row["psnr"] > 10 for row in rows)


def test_a_scene_alone(pocketgs: Callable[..., Any], result: Path, tmp_path: Path) -> None:
    path = tmp_path / "small.pgs"
    (tmp_path / "cameras.json").write_text('[{"id": 0, "img_name": "a.png"}]')  # as other programs write it
    scene = shutil.copy(result / "scene.ply", tmp_path / "scene.ply")
    outcome = pocketgs("compress", scene, "--output", path, "--time-budget", 5)
    assert outcome.status == 0, outcome.errors
    assert "renderings of the original" in outcome.output
    assert len(read_scene(path)) > 0


def test_a_moved_scene_beside_a_result(pocketgs: Callable[..., Any], result: Path, tmp_path: Path) -> None:
    """The cameras of the result would not show it."""
    path, moved = tmp_path / "small.pgs", result / "moved.ply"
    pocketgs("convert", result, moved, "--translate", 0, 0, -100)
    outcome = pocketgs("compress", moved, "--output", path, "--size", 0.01, "--time-budget", 5)
    assert outcome.status == 0
    assert f"warning: {moved}: may have been moved since the run beside it" in outcome.errors
    outcome = pocketgs("distil", moved, "--output", tmp_path / "free.ply")
    assert outcome.status == 2
    assert "expected its result folder, or its capture" in outcome.errors


def test_one_far_gaussian_makes_the_grid_coarse(pocketgs: Callable[..., Any], result: Path, tmp_path: Path) -> None:
    scene = read_scene(result / "scene.ply")
    scene.means[0] = 4e6
    scene.save(tmp_path / "far.ply")
    path = tmp_path / "far.pgs"
    outcome = pocketgs("compress", tmp_path / "far.ply", "--output", path, "--size", 1, "--time-budget", 1)
    assert outcome.status == 0, outcome.errors
    assert outcome.errors.startswith(f"warning: {path}: centres are rounded")
    assert outcome.errors.count("centres are rounded") == 1, "and none about other files"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--output", "out.ply"], "not the name of a compressed scene, expected one that ends in .pgs"),
        (["--output", "nowhere/out.pgs"], "its folder does not exist"),
        (["--output", "out.pgs", "--json", "nowhere/figures.json"], "its folder does not exist"),
        (["--output", "out.pgs", "--json", "../{}/out.pgs"], "named by both --output and --json, expected two files"),
        (["--output", "folder.pgs"], "folder.pgs: is a folder"),
        (["--output", "out.pgs", "--size", "1", "--quality", "1"], "both --size and --quality"),
        (["--output", "out.pgs", "--size", "0"], "size: found 0.0, expected megabytes above 0"),
        (["--output", "out.pgs", "--quality", "nan"], "quality: found nan, expected dB, at least 0"),
        (["missing", "--output", "out.pgs"], "missing"),
    ],
)
def test_mistakes_leave_files_alone(
    pocketgs: Callable[..., Any],
    result: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("out.pgs").write_bytes(b"PGSC before")
    Path("folder.pgs").mkdir()
    outcome = pocketgs("compress", result, *(argument.format(tmp_path.name) for argument in arguments))
    assert outcome.status == 2
    assert message in outcome.errors
    assert Path("out.pgs").read_bytes() == b"PGSC before"


def test_distil_notices_a_folder_in_the_way(
    pocketgs: Callable[..., Any], result: Path, written_capture: Path, tmp_path: Path
) -> None:
    (tmp_path / "folder.ply").mkdir()
    outcome = pocketgs("distil", result, written_capture, "--output", tmp_path / "folder.ply", "--iterations", 0)
    assert outcome.status == 2
    assert "folder.ply: is a folder, expected the name of a file in an existing folder" in outcome.errors


def test_what_is_no_scene(pocketgs: Callable[..., Any], written_capture: Path, tmp_path: Path) -> None:
    outcome = pocketgs("compress", written_capture, "--output", tmp_path / "out.pgs")
    assert outcome.status == 2
    assert "no scene, expected a scene file or a result folder, then the capture" in outcome.errors


def test_another_size_of_photographs_is_noticed(
    pocketgs: Callable[..., Any], result: Path, written_capture: Path, tmp_path: Path
) -> None:
    options = ["--downscale", 2, "--size", 0.02, "--time-budget", 1]
    outcome = pocketgs("compress", result, written_capture, "--output", tmp_path / "out.pgs", *options)
    assert outcome.status == 0, outcome.errors
    assert "warning: " in outcome.errors
    assert "its run is '96x72, held out every 8th by name', here it is 'downscaled to 48x36, held out" in outcome.errors


def test_training_and_compressing(pocketgs: Callable[..., Any], written_capture: Path, tmp_path: Path) -> None:
    folder = tmp_path / "result"
    options = ["--output", folder, "--prior", "none", "--iterations", 20, "--evaluate-every", 0]
    assert pocketgs("train", written_capture, *options, "--compress").status == 0
    assert (folder / "scene.pgs").stat().st_size < (folder / "scene.ply").stat().st_size / 4
    # The next run's scene is another one.
    assert pocketgs("train", written_capture, *options).status == 0
    assert not (folder / "scene.pgs").exists()
    # So it is with a file that was compressed later.
    compress = ["compress", folder, written_capture, "--output", folder / "scene.pgs", "--time-budget", 1]
    assert [pocketgs(*compress).status for _ in range(2)] == [0, 0]
    assert pocketgs("train", written_capture, *options).status == 0
    assert not (folder / "scene.pgs").exists()
    (folder / "scene.pgs").write_bytes(b"somebody else's")
    for command in (["train", written_capture, *options], compress):
        outcome = pocketgs(*command)
        assert outcome.status == 2
        assert "scene.pgs: was not written by pocketgs" in outcome.errors
        assert "training" not in outcome.output
    assert (folder / "scene.pgs").read_bytes() == b"somebody else's"


def test_a_scene_that_spz_cannot_hold(
    pocketgs: Callable[..., Any], result: Path, written_capture: Path, tmp_path: Path
) -> None:
    """With NaN, which is left out, and with a coordinate that is too large."""
    scene = read_scene(result / "scene.ply")
    scene.means[0] = np.nan
    scene.means[1] = 1e7
    scene.save(tmp_path / "broken.ply")
    path, figures = tmp_path / "small.pgs", tmp_path / "figures.json"
    options = ["--output", path, "--json", figures, "--size", 0.02, "--time-budget", 1, "--poses-of", result]
    outcome = pocketgs("compress", tmp_path / "broken.ply", written_capture, *options)
    assert outcome.status == 0
    left_out = f"broken.ply: 1 of {len(scene):,} Gaussians hold NaN or infinity and are left out"
    assert outcome.errors == f"warning: {tmp_path}/{left_out}\n", "the far Gaussian was pruned: nothing is coarse"
    original, spz, *_ = json.loads(figures.read_text())["figures"]
    assert original["gaussians"] == len(scene) - 1
    assert (spz["name"], spz["megabytes"], spz["psnr"]) == (".spz", None, None)
    assert "n/a" in outcome.output


def test_views_too_small_to_report_on(
    pocketgs: Callable[..., Any], result: Path, written_capture: Path, tmp_path: Path
) -> None:
    outcome = pocketgs("compress", result, written_capture, "--output", tmp_path / "out.pgs", "--downscale", 8)
    assert outcome.status == 2
    assert "a held-out view of 12x9 pixels" in outcome.errors


def test_memory_is_checked_before_anything_is_rendered(
    pocketgs: Callable[..., Any], result: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pocketgs.cli.commands.compress.rendered", lambda *_: pytest.fail("rendered"))
    monkeypatch.setattr("pocketgs.cli.commands.compress.memory_needed", lambda *_: 10**13)
    outcome = pocketgs("compress", result, "--output", tmp_path / "out.pgs")
    assert outcome.status == 2
    assert "compression would take" in outcome.errors


def test_transients_of_the_run_are_left_out(
    result: Path, written_capture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capture = open_capture(written_capture)
    assert as_trained_on(result, capture).train[0].mask is None
    cells = [np.zeros((6, 8), np.bool_) for _ in capture.train]
    cells[1][2, 3] = True
    checkpoint = read_checkpoint(result, {})
    write_checkpoint(result / CHECKPOINT, replace(checkpoint, transients=tuple(cells)), {})
    first, second, *_ = as_trained_on(result, capture).train
    assert first.mask is None
    assert second.mask is not None
    np.testing.assert_array_equal(np.argwhere(~second.mask), np.argwhere(np.kron(cells[1], np.ones((12, 12)))))
    assert capsys.readouterr().err == ""
    # Smaller copies have other names: whose cells these are is unknown.
    smaller = Path(shutil.copytree(written_capture, tmp_path / "capture"))
    shutil.copytree(smaller / "images", smaller / "images_2")
    assert all(frame.mask is None for frame in as_trained_on(result, open_capture(smaller, images="images_2")).train)
    assert "had other training views: nothing is masked here; give the options" in capsys.readouterr().err
    # As with another number of training views.
    write_checkpoint(result / CHECKPOINT, replace(checkpoint, transients=tuple(cells[1:])), {})
    assert all(frame.mask is None for frame in as_trained_on(result, capture).train)


def test_photographs_that_the_run_left_out_whole_are_not_distilled_from(
    pocketgs: Callable[..., Any], result: Path, written_capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cells = [np.zeros((6, 8), np.bool_) for _ in open_capture(written_capture).train]
    cells[1][:] = True
    checkpoint = read_checkpoint(result, {})
    write_checkpoint(result / CHECKPOINT, replace(checkpoint, transients=tuple(cells)), {})
    seen: list[Capture] = []

    def stop(_: Gaussians, capture: Capture, *__: object) -> NoReturn:
        seen.append(capture)
        raise PocketGSError("enough is known")

    monkeypatch.setattr("pocketgs.cli.commands.distil.distil_scene", stop)
    outcome = pocketgs("distil", result, written_capture, "--output", tmp_path / "free.ply")
    assert "enough is known" in outcome.errors
    assert len(seen[0].train) == len(cells) - 1


@pytest.mark.parametrize("command", ["compress", "distil"])
def test_the_reading_of_the_run_is_kept(
    pocketgs: Callable[..., Any],
    result: Path,
    written_capture: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: str,
) -> None:
    """Its background, unless another is given; of other held-out views there is a warning."""
    record = json.loads((result / "run.json").read_text())
    record["capture"]["background"] = [1.0, 0.5, 0.25]
    record["protocol"] = "96x72, on RGB (1, 0.5, 0.25), held out every 8th by name"
    (result / "run.json").write_text(json.dumps(record))
    seen: list[Capture] = []

    def stop(_: object, capture: Capture, *__: object) -> None:
        seen.append(capture)
        raise PocketGSError("stopped")

    monkeypatch.setattr("pocketgs.cli.commands.compress.photographed", lambda capture: stop(None, capture))
    monkeypatch.setattr("pocketgs.cli.commands.distil.distil_scene", stop)
    given = [command, result, written_capture, "--output", tmp_path / "out.pgs"]
    assert "warning" not in pocketgs(*given).errors
    outcome = pocketgs(*given, "--background", 0, 0, 0, "--hold-out", 3)
    assert "was trained on 2 of the 3 views that are held out" in outcome.errors
    assert [capture.background for capture in seen] == [(1.0, 0.5, 0.25), (0.0, 0.0, 0.0)]


@pytest.mark.parametrize("error", [KeyboardInterrupt(), PocketGSError("compression: it cannot be")])
def test_a_run_outlives_its_compression(
    pocketgs: Callable[..., Any],
    written_capture: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
) -> None:
    """The photographs are masked as in training, and what ends compression early does not end the run."""
    train, given = compressing_run.run, []

    def with_transients(*arguments: Any, **options: Any) -> Any:
        found = train(*arguments, **options)
        views = json.loads((tmp_path / "result" / "run.json").read_text())["capture"]["training_views"]
        return replace(found, transients=(np.eye(3, 4, dtype=np.bool_),) * views)

    def fails(scene: Any, views: Views, *_: Any, **__: Any) -> None:
        given.append(views)
        raise error

    monkeypatch.setattr(compressing_run, "run", with_transients)
    monkeypatch.setattr(compressing_run, "compress_in_time", fails)
    options = ["--output", tmp_path / "result", "--prior", "none", "--iterations", 5, "--evaluate-every", 0]
    outcome = pocketgs("train", written_capture, *options, "--compress")
    assert (outcome.status, outcome.errors) == (0, "")
    assert "not compressed" in outcome.output
    if isinstance(error, KeyboardInterrupt):
        assert f"compress {tmp_path / 'result'} CAPTURE --output {tmp_path / 'result' / 'scene.pgs'}" in outcome.output
    assert (tmp_path / "result" / "scene.ply").is_file()
    assert all(frame.mask is not None and not frame.mask[0, 0] for frame in given[0].train)


@pytest.mark.parametrize("stopped", [False, True])
def test_a_run_that_was_stopped_is_not_compressed(
    pocketgs: Callable[..., Any], result: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stopped: bool
) -> None:
    """Even if it was stopped after training, while it was evaluated."""
    summary = json.loads((result / "run.json").read_text())
    finished = RunResult(result, Gaussians.load(result / "scene.ply"), None, summary, stopped=stopped)
    compressed: list[object] = []

    def train(*_: object, reporter: Reporter, **__: object) -> RunResult:
        reporter.on_prepared(Capture("room", tmp_path, "toys", [], []))
        return finished

    monkeypatch.setattr(compressing_run, "run", train)
    monkeypatch.setattr(compressing_run.CompressingRun, "_compress", lambda *given: compressed.append(given))
    outcome = pocketgs("train", tmp_path / "room", "--output", result, "--compress")
    assert bool(compressed) != stopped
    assert ("not compressed, since the run was stopped: pocketgs compress" in outcome.output) == stopped


def test_two_fifths_of_a_time_budget_are_for_compression(
    pocketgs: Callable[..., Any], written_capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    budgets: list[float | None] = []

    def stop(_: object, __: Path, options: TrainingOptions, **___: object) -> NoReturn:
        budgets.append(options.time_budget)
        raise PocketGSError("enough is known")

    monkeypatch.setattr(compressing_run, "run", stop)
    command = ["train", written_capture, "--output", tmp_path / "out", "--compress"]
    for options in ([], ["--time-budget", 50]):
        assert "enough is known" in pocketgs(*command, *options).errors
    assert budgets == [None, 30.0]
