"""Files and output of train, eval and info."""

from __future__ import annotations

import json
import shutil
import signal
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from cli.conftest import Outcome
from pocketgs import Gaussians
from pocketgs.capture import list_capture
from pocketgs.capture.capture import Frame
from pocketgs.cli.run_result import print_evaluation
from pocketgs.cli.scene_file import capture_of
from pocketgs.cli.terminal import Terminal
from pocketgs.errors import PocketGSError
from pocketgs.metrics.evaluation import Evaluation, ImageMetrics
from pocketgs.results.reporter import Reporter
from pocketgs.results.run import run
from pocketgs.system.process import peak_rss_mb
from pocketgs.training import transients
from pocketgs.training.options import TrainingOptions
from pocketgs.training.progress import Progress
from pocketgs.training.view_residuals import grid_of

FILES = ["cameras.json", "checkpoint.npz"]

PLAIN = ["--prior", "none"]
"""Options of runs for which the initial points do not matter: they use the capture's own."""


def names_in(folder: Path) -> list[str]:
    """Paths of the files that a user sees."""
    paths = (path.relative_to(folder) for path in folder.rglob("*"))
    return sorted(path.as_posix() for path in paths if not path.parts[0].startswith("."))


def record_of(folder: Path) -> dict[str, Any]:
    def refuse(name: str) -> None:
        raise ValueError(f"{name} is not JSON")

    return dict(json.loads((folder / "run.json").read_text(), parse_constant=refuse))


def test_result_folder(result: Path) -> None:
    assert names_in(result) == [
        "cameras.json",
        "checkpoint.npz",
        "held_out",
        "held_out/images_0000.png",
        "run.json",
        "scene.ply",
    ]
    scene, record = Gaussians.load(result / "scene.ply"), record_of(result)
    assert record["gaussians"] == len(scene) == 2000
    assert (record["iterations"], record["interrupted"]) == (40, False)
    assert 15 < record["psnr"] < 60
    assert 0.3 < record["ssim"] < 1
    assert record["protocol"] == "96x72, held out every 8th by name"
    assert 50 < record["peak_rss_mb"] <= peak_rss_mb() + 1  # the system may forget a short peak
    seconds = record["seconds"]
    assert {"startup", "capture", "seeding", "compilation", "training", "evaluation", "writing", "total"} <= set(
        seconds
    )
    assert all(value >= 0 for value in seconds.values())
    stages = sum(value for stage, value in seconds.items() if stage != "total")
    assert stages <= seconds["total"] * 1.01 + 0.01
    assert record["options"]["iterations"] == 40
    assert (record["coverage"], record["keyframes"]) == (None, None)  # nobody has looked
    assert [sample["iteration"] for sample in record["progress"]] == [20, 40]
    assert record["progress"][0]["loss"] > record["progress"][1]["loss"]
    assert record["capture"]["training_views"] == 7
    assert record["images"][0]["name"] == "images/0000.png"
    assert record["versions"]["pocketgs"]


def test_pictures_show_photograph_and_rendering(result: Path, written_capture: Path) -> None:
    pair = np.asarray(Image.open(result / "held_out" / "images_0000.png"))
    photo = np.asarray(Image.open(written_capture / "images" / "0000.png"))
    assert pair.shape == (72, 192, 3)
    np.testing.assert_array_equal(pair[:, :96], photo)
    # PSNR of the picture's right half is the record's, but for rounding to 8 bits.
    error = np.mean((pair[:, 96:] / 255.0 - photo / 255.0) ** 2)
    assert -10 * np.log10(error) == pytest.approx(record_of(result)["psnr"], abs=0.05)


def test_eval_gives_the_figures_of_the_run(
    pocketgs: Callable[..., Any], result: Path, written_capture: Path, tmp_path: Path
) -> None:
    command = ["eval", result, written_capture, "--json", tmp_path / "a.json", "--pictures", tmp_path / "pictures"]
    outcome = pocketgs(*command)
    assert (outcome.status, outcome.errors) == (0, "")
    found, expected = json.loads((tmp_path / "a.json").read_text()), record_of(result)
    for key in ("psnr", "ssim"):
        assert found[key] == pytest.approx(expected[key], abs=1e-6)
        assert found["images"][0][key] == pytest.approx(expected["images"][0][key], abs=1e-6)
    assert (found["protocol"], found["gaussians"]) == (expected["protocol"], expected["gaussians"])
    assert f"{expected['psnr']:.2f}" in outcome.output
    pictures = [folder / "images_0000.png" for folder in (tmp_path / "pictures", result / "held_out")]
    assert pictures[0].read_bytes() == pictures[1].read_bytes()
    assert names_in(tmp_path / "pictures") == ["images_0000.png"]


def test_views_are_listed_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    """COLMAP models list images as they were registered."""
    names = ["10.png", "b/3.png", "9.png", "a 2 b.png", "", "b/20.png", "a 10.png", "b/"]
    print_evaluation(Terminal(), Evaluation([ImageMetrics(name, 20.0, 0.5, 20.0) for name in names]))
    shown = [line.split("│")[1].strip() for line in capsys.readouterr().out.splitlines() if "│" in line]
    assert shown[:-1] == ["", "9.png", "10.png", "a 2 b.png", "a 10.png", "b/", "b/3.png", "b/20.png"]


def test_eval_of_other_pixels_gives_other_figures(
    pocketgs: Callable[..., Any], result: Path, written_capture: Path, tmp_path: Path
) -> None:
    pocketgs("eval", result / "scene.ply", written_capture, "--json", tmp_path / "a.json", "--downscale", "2")
    found = json.loads((tmp_path / "a.json").read_text())
    assert found["protocol"] == "downscaled to 48x36, held out every 8th by name"
    assert found["psnr"] != pytest.approx(record_of(result)["psnr"], abs=1e-3)


def test_eval_refuses_views_that_were_trained_on(
    pocketgs: Callable[..., Any], result: Path, written_capture: Path, tmp_path: Path
) -> None:
    given = ["eval", result, written_capture, "--hold-out", 3, "--json", tmp_path / "a.json"]
    outcome = pocketgs(*given)
    assert outcome.status == 2
    assert "was trained on 2 of the 3 views that are held out, the first images/0003.png" in outcome.errors
    assert "its run is '96x72, held out every 8th by name', here it is '96x72, held out every 3rd" in outcome.errors
    assert "give the options that it was trained with, such as --images, --downscale, --max-size" in outcome.errors
    assert not (tmp_path / "a.json").exists()
    command = ["train", written_capture, "--output", tmp_path / "all", "--hold-out", 0, "--iterations", 1, *PLAIN]
    assert pocketgs(*command).status == 0
    assert "its run held nothing out: train it with" in pocketgs("eval", tmp_path / "all", written_capture).errors
    # Of a scene without its run nothing is known.
    moved = shutil.copy(result / "scene.ply", tmp_path / "scene.ply")
    assert pocketgs("eval", moved, *given[2:]).status == 0


def test_eval_knows_photographs_by_their_poses(
    pocketgs: Callable[..., Any], result: Path, capture_folder: Path, tmp_path: Path
) -> None:
    """In another image folder they have other names."""
    shutil.copytree(capture_folder / "images", capture_folder / "images_2")
    given = ["eval", result, capture_folder, "--images", "images_2", "--json", tmp_path / "a.json"]
    outcome = pocketgs(*given, "--hold-out", 3)
    assert outcome.status == 2
    assert "was trained on 2 of the 3 views that are held out, the first images_2/0003.png" in outcome.errors
    assert not (tmp_path / "a.json").exists()
    # The same views are held out: nothing is wrong, as far as is known.
    outcome = pocketgs(*given)
    assert outcome.status == 0
    assert "warning: " in outcome.errors
    assert "no photograph has a name that its run knows, such as images/0001.png, the first is images_2/" in (
        outcome.errors
    )
    assert json.loads((tmp_path / "a.json").read_text())["psnr"] == pytest.approx(record_of(result)["psnr"], abs=1e-6)


def test_eval_of_a_capture_whose_poses_have_changed(
    pocketgs: Callable[..., Any], capture_folder: Path, tmp_path: Path
) -> None:
    """The scene is in another world; figures would only seem to judge it."""
    result, copy = tmp_path / "result", tmp_path / "copy"
    assert pocketgs("train", capture_folder, "--output", result, "--iterations", 1, *PLAIN).status == 0
    document = json.loads((capture_folder / "transforms.json").read_text())
    for frame in document["frames"]:
        frame["transform_matrix"][0][3] += 0.2
    (capture_folder / "transforms.json").write_text(json.dumps(document))
    shutil.copytree(capture_folder, copy)
    outcome = pocketgs("eval", result, capture_folder)
    assert outcome.status == 2
    assert "toys have changed since this scene was trained" in outcome.errors
    # Elsewhere it may be another capture in the world of the scene.
    outcome = pocketgs("eval", result, copy)
    assert outcome.status == 0
    assert "warning: " in outcome.errors
    assert "8 views have other poses than in its run" in outcome.errors
    assert pocketgs("render", result, capture_folder, "--output", tmp_path / "pictures").status == 2
    other_poses = capture_folder / "other_poses.json"
    (capture_folder / "transforms.json").rename(other_poses)
    assert pocketgs("eval", result, other_poses).status == 0


def test_eval_says_that_the_run_reduced_photographs(
    pocketgs: Callable[..., Any], result: Path, written_capture: Path, tmp_path: Path
) -> None:
    """Its options cannot do that."""
    reduced = Path(shutil.copytree(result, tmp_path / "reduced"))
    record = record_of(reduced)
    record["protocol"], record["plan"]["shrink"] = "downscaled to 48x36, held out every 8th by name", 2
    (reduced / "run.json").write_text(json.dumps(record))
    outcome = pocketgs("eval", reduced, written_capture)
    assert "to fit in memory, its run reduced photographs by another factor of 2" in outcome.errors
    assert "give the options" not in outcome.errors


def test_eval_warns_of_another_protocol(pocketgs: Callable[..., Any], result: Path, written_capture: Path) -> None:
    outcome = pocketgs("eval", result, written_capture, "--downscale", 2)
    assert outcome.status == 0
    assert f"warning: {result}: the protocol of its run is '96x72, held out every 8th by name'" in outcome.errors
    assert "here it is 'downscaled to 48x36, held out every 8th by name'; give the options" in outcome.errors


def test_eval_uses_the_background_of_the_run(
    pocketgs: Callable[..., Any], written_capture: Path, tmp_path: Path
) -> None:
    command = ["train", written_capture, "--output", tmp_path / "white", "--iterations", 1, *PLAIN]
    assert pocketgs(*command, "--background", 1, 1, 1).status == 0
    figures = []
    for options in ([], ["--background", 1, 1, 1], ["--background", 0, 0, 0]):
        pocketgs("eval", tmp_path / "white", written_capture, "--json", tmp_path / "a.json", *options)
        figures.append(json.loads((tmp_path / "a.json").read_text())["psnr"])
    assert figures[0] == figures[1] == pytest.approx(record_of(tmp_path / "white")["psnr"], abs=1e-6)
    assert figures[0] != pytest.approx(figures[2], abs=1e-3)


def test_nothing_held_out(pocketgs: Callable[..., Any], result: Path, written_capture: Path) -> None:
    """Nor do pictures of the earlier result stay, which show another scene."""
    outcome = pocketgs("train", written_capture, "--output", result, "--hold-out", 0, "--iterations", 3, *PLAIN)
    assert (outcome.status, outcome.errors) == (0, "")
    assert outcome.output.endswith(": scene.ply, run.json\n")
    record = record_of(result)
    assert record["psnr"] is None
    assert record["ssim"] is None
    assert record["images"] == record["progress"] == []
    assert record["capture"]["training_views"] == 8
    assert names_in(result) == ["cameras.json", "checkpoint.npz", "run.json", "scene.ply"]


def test_frames_of_one_name_get_a_picture_each(
    pocketgs: Callable[..., Any], capture_folder: Path, tmp_path: Path
) -> None:
    document = json.loads((capture_folder / "transforms.json").read_text())
    for frame, name in zip(document["frames"][:2], ["images/a.png", "images_a.png"], strict=True):
        (capture_folder / frame["file_path"]).rename(capture_folder / name)
        frame["file_path"] = name
    document["test_filenames"] = ["images/a.png", "images_a.png"]
    (capture_folder / "transforms.json").write_text(json.dumps(document))
    assert pocketgs("train", capture_folder, "--output", tmp_path / "out", "--iterations", 1, *PLAIN).status == 0
    assert sorted(path.name for path in (tmp_path / "out" / "held_out").iterdir()) == ["images_a.png", "images_a_2.png"]


@pytest.mark.parametrize("named", ["toys", "toys/transforms.json"])
def test_default_folder(
    pocketgs: Callable[..., Any], capture_folder: Path, monkeypatch: pytest.MonkeyPatch, named: str
) -> None:
    monkeypatch.chdir(capture_folder.parent)
    assert pocketgs("train", named, "--iterations", 1, *PLAIN).status == 0
    assert (capture_folder.parent / "output" / "toys" / "scene.ply").is_file()


def test_resumed_run_is_the_uninterrupted_one(
    pocketgs: Callable[..., Any], written_capture: Path, tmp_path: Path
) -> None:
    """To the last bit, though Ctrl-C stopped it half-way. What the recipe decided may be spelled out."""
    stopped, whole = tmp_path / "stopped", tmp_path / "whole"

    def press_ctrl_c(progress: Progress) -> None:
        if progress.iteration == 10:
            signal.raise_signal(signal.SIGINT)

    def load() -> Any:
        return list_capture(written_capture)

    first = run(
        load, stopped, TrainingOptions(iterations=20, prior="none"), reporter=Reporter(on_progress=press_ctrl_c)
    )
    assert (first.summary["iterations"], first.summary["interrupted"]) == (10, True)
    assert record_of(stopped)["interrupted"] is True
    half = (stopped / "scene.ply").read_bytes()
    resume = ("--output", stopped, "--iterations", 20, "--resume", "--sh-degree", 2)
    resumed = pocketgs("train", written_capture, *resume, *PLAIN)
    assert (resumed.status, resumed.errors) == (0, "")
    assert pocketgs("train", written_capture, "--output", whole, "--iterations", 20, *PLAIN).status == 0
    assert (stopped / "scene.ply").read_bytes() == (whole / "scene.ply").read_bytes() != half
    assert (record_of(stopped)["iterations"], record_of(stopped)["interrupted"]) == (20, False)
    assert record_of(stopped)["psnr"] == record_of(whole)["psnr"]
    with np.load(stopped / "checkpoint.npz") as one, np.load(whole / "checkpoint.npz") as other:
        assert sorted(one) == sorted(other)
        assert all(one[name].tobytes() == other[name].tobytes() for name in one)


def test_second_ctrl_c_leaves_the_earlier_result(
    written_capture: Path, result: Path, contents: Callable[[Path], dict[str, bytes]]
) -> None:
    before = contents(result)

    def press_ctrl_c(progress: Progress) -> None:
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)

    reporter = Reporter(on_progress=press_ctrl_c)
    with pytest.raises(KeyboardInterrupt):
        run(lambda: list_capture(written_capture), result, TrainingOptions(prior="none"), reporter=reporter)
    assert contents(result) == before


@pytest.mark.parametrize("stage", ["keyframes", "poses", "depth", "fusion", "seeding"])
def test_ctrl_c_before_training_leaves_the_earlier_result(
    written_capture: Path, result: Path, contents: Callable[[Path], dict[str, bytes]], stage: str
) -> None:
    before = contents(result)

    def press_ctrl_c(name: str) -> None:
        if name == stage:
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        run(lambda: list_capture(written_capture), result, TrainingOptions(), reporter=Reporter(press_ctrl_c))
    assert contents(result) == before


def test_info(pocketgs: Callable[..., Any], result: Path, written_capture: Path) -> None:
    of_capture, of_result = pocketgs("info", written_capture), pocketgs("info", result)
    of_scene = pocketgs("info", result / "scene.ply")
    assert of_capture.status == of_result.status == of_scene.status == 0
    assert of_capture.errors == of_result.errors == ""
    assert "toys (nerfstudio): 7 training views, 1 held out, 2,000 points, scene units" in of_capture.output
    assert "images: 96x72" in of_capture.output
    degree = Gaussians.load(result / "scene.ply").sh_degree
    assert f"2,000 Gaussians, spherical harmonics of degree {degree}" in of_result.output
    assert of_scene.output == of_result.output
    assert "5 training views, 3 held out" in pocketgs("info", written_capture, "--hold-out", 3).output


def test_info_of_a_capture_larger_than_memory(pocketgs: Callable[..., Any], capture_folder: Path) -> None:
    document = json.loads((capture_folder / "transforms.json").read_text())
    for frame in list(document["frames"]):
        file = capture_folder / frame["file_path"]
        for copy in (file, file.with_stem(f"copy_{file.stem}")):
            Image.open(file).resize((480, 360)).save(copy)
        document["frames"].append(frame | {"file_path": copy.relative_to(capture_folder).as_posix()})
    (capture_folder / "transforms.json").write_text(json.dumps(document))
    told = pocketgs("info", capture_folder, "--max-memory", 6)
    assert told.errors == ""
    assert "14 training views, 2 held out" in told.output
    assert "read at 1/2 of their size to fit in --max-memory: at full size, up to 480x360, they would" in told.output
    assert "images: 240x180" in told.output
    assert "images: 480x360" in pocketgs("info", capture_folder).output


def test_a_second_run_is_refused_and_the_first_one_ends_well(
    pocketgs: Callable[..., Any], written_capture: Path, tmp_path: Path
) -> None:
    said = []

    def meddle(progress: Progress) -> None:
        if progress.iteration == 2:
            said.append(pocketgs("train", written_capture, "--output", tmp_path / "out", "--downscale", 5000))

    options = TrainingOptions(iterations=3, prior="none")
    run(lambda: list_capture(written_capture), tmp_path / "out", options, reporter=Reporter(on_progress=meddle))
    (refused,) = said
    assert refused.status == 2
    assert refused.errors == f"pocketgs: {tmp_path / 'out'}: another pocketgs process is writing there, " + (
        "expected it to end first\n"
    )
    assert names_in(tmp_path / "out") == [*FILES, "held_out", "held_out/images_0000.png", "run.json", "scene.ply"]


def test_a_staging_folder_that_vanishes_fails_the_run(written_capture: Path, tmp_path: Path) -> None:
    def remove(stage: str) -> None:
        if stage == "evaluation":
            (staging,) = (tmp_path / "out" / ".pocketgs").glob("staging-*")
            shutil.rmtree(staging)

    options = TrainingOptions(iterations=1, prior="none")
    with pytest.raises(PocketGSError, match="cannot be written"):
        run(lambda: list_capture(written_capture), tmp_path / "out", options, reporter=Reporter(on_stage=remove))
    assert not (tmp_path / "out").exists()


def test_the_capture_itself_is_no_place_for_a_result(
    pocketgs: Callable[..., Any], capture_folder: Path, contents: Callable[[Path], dict[str, bytes]]
) -> None:
    before = contents(capture_folder)
    outcome = pocketgs("train", capture_folder, "--output", capture_folder, "--iterations", 1, *PLAIN)
    assert outcome.status == 2
    assert "holds a capture, expected another folder for the result" in outcome.errors
    assert contents(capture_folder) == before


def test_captures_of_one_name_are_told_apart(
    pocketgs: Callable[..., Any], capture_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    other = Path(shutil.copytree(capture_folder, tmp_path / "elsewhere" / "toys"))
    command = ["--iterations", 1, *PLAIN]
    assert pocketgs("train", capture_folder, *command).status == 0
    assert pocketgs("train", "toys/transforms.json", *command).status == 0
    refused = pocketgs("train", other, *command)
    assert refused.status == 2
    assert "output/toys: holds the result of another capture of this name" in refused.errors.replace("\\", "/")
    assert pocketgs("train", other, *command, "--output", "output/toys").status == 0
    assert str(tmp_path) not in (tmp_path / "output" / "toys" / "run.json").read_text()


def test_photographs_that_the_others_contradict_are_named(
    pocketgs: Callable[..., Outcome], written_capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def second_is_wrong(_: object, frames: Sequence[Frame], __: object) -> list[np.ndarray]:
        return [np.full(grid_of(frame), number == 1) for number, frame in enumerate(frames)]

    monkeypatch.setattr(transients, "FIRST_LOOK", 10)
    monkeypatch.setattr(transients, "FIRST_EPOCHS", 1)
    monkeypatch.setattr(transients, "transient_cells", second_is_wrong)
    outcome = pocketgs("train", written_capture, "--output", tmp_path / "result", *PLAIN, "--iterations", 30)
    assert outcome.status == 0
    record = record_of(tmp_path / "result")
    [name] = record["transients"]["left_out"]
    assert record["transients"]["photographs"] == record["transients"]["share"] == 0
    assert f"1 photograph contradicts the others, left out of training (a wrong pose, or another place?): {name}" in (
        outcome.output + outcome.errors
    )
    assert len(list((tmp_path / "result" / "transients").iterdir())) == 1


def test_photographs_stand_for_what_training_made_of_them(written_capture: Path, tmp_path: Path) -> None:
    result, photographs = tmp_path / "result", tmp_path / "photographs"
    shutil.copytree(written_capture / "images", photographs)
    assert capture_of(result, photographs) == photographs
    made = shutil.copytree(written_capture, result / "posed" / "photographs")
    assert capture_of(result, photographs) == made
    assert capture_of(result / "scene.ply", photographs) == made
    assert capture_of(result, written_capture) == written_capture
