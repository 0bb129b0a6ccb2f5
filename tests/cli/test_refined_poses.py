"""The demo, whose poses are refined: a scene lies in a world that its result folder remembers."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from pocketgs import Gaussians
from pocketgs.capture import open_capture
from pocketgs.errors import PocketGSError
from pocketgs.files.manifest import MANIFEST, read_manifest, source_of
from pocketgs.geometry.camera import Camera
from pocketgs.results.cameras_file import read_cameras
from scene.formats.scenes import random_scene


def record_of(folder: Path) -> dict[str, Any]:
    return dict(json.loads((folder / "run.json").read_text()))


def names_in(folder: Path) -> list[str]:
    """Names of the files that a user sees."""
    return sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))


def figures(pocketgs: Callable[..., Any], *arguments: Path) -> dict[str, Any]:
    """The output of `pocketgs eval`."""
    file = arguments[-1].parent / "figures.json"
    outcome = pocketgs("eval", *arguments, "--json", file)
    assert (outcome.status, outcome.errors) == (0, "")
    found = dict(json.loads(file.read_text()))
    assert f"{found['psnr']:.2f}" in outcome.output
    return found


def test_demo(small_demo: Path) -> None:
    result, record = small_demo / "result", record_of(small_demo / "result")
    assert names_in(result) == ["cameras.json", "checkpoint.npz", "held_out", "run.json", "scene.ply"]
    scene = Gaussians.load(result / "scene.ply")
    assert scene.sh_degree == 1
    assert record["capture"]["metric"] is True
    assert record["capture"]["points"] == 0
    assert (record["iterations"], record["gaussians"]) == (100, len(scene))
    assert record["psnr"] > 16


def test_record_of_the_prior(small_demo: Path) -> None:
    record = record_of(small_demo / "result")
    prior, capture = record["prior"], open_capture(small_demo / "capture")
    assert prior["poses_refined"] is True
    assert prior["rmse"] < 0.8 * prior["rmse_given"]
    assert prior["points"] == record["gaussians"] <= 3000
    assert [decision["name"] for decision in prior["decisions"]] == [frame.name for frame in capture.train]
    assert 2 <= sum(decision["kept"] for decision in prior["decisions"]) <= record["options"]["max_keyframes"]
    assert {"keyframes", "poses", "depth", "fusion", "coverage", "training"} <= set(record["seconds"])
    assert record["keyframes"] == sum(decision["kept"] for decision in prior["decisions"])
    assert record["coverage"] == prior["coverage"]
    assert 0.9 < record["coverage"] <= 1
    assert 0.3 < prior["coverage_known"] <= prior["coverage"]
    assert (record["options"]["effort"], record["options"]["max_keyframes"]) == ("quick", 40)
    assert (record["options"]["prior"], record["options"]["seeds"]) == ("dense", "discs")
    saved = read_cameras(small_demo / "result" / "cameras.json")
    assert saved.refined
    assert set(saved.cameras) == {frame.name for frame in capture.frames}


def test_eval_gives_the_figures_of_the_run(pocketgs: Callable[..., Any], small_demo: Path) -> None:
    result, capture, expected = small_demo / "result", small_demo / "capture", record_of(small_demo / "result")
    for scene in (result, result / "scene.ply"):
        found = figures(pocketgs, scene, capture)
        assert found["psnr"] == pytest.approx(expected["psnr"], abs=1e-6)
        assert found["ssim"] == pytest.approx(expected["ssim"], abs=1e-6)


def test_at_the_captures_own_poses_the_scene_is_seen_from_elsewhere(
    pocketgs: Callable[..., Any], small_demo: Path
) -> None:
    (small_demo / "result" / "cameras.json").unlink()
    file = small_demo / "figures.json"
    outcome = pocketgs("eval", small_demo / "result", small_demo / "capture", "--json", file)
    assert 'split, poses refined", here it is "160x120, data' in outcome.errors
    assert json.loads(file.read_text())["psnr"] < record_of(small_demo / "result")["psnr"] - 0.5


def test_a_scene_outside_its_result_folder(pocketgs: Callable[..., Any], small_demo: Path) -> None:
    """It is judged at the poses of the result that is named; without one, a warning says that its run is unknown."""
    result, capture, alone = small_demo / "result", small_demo / "capture", small_demo / "alone.ply"
    shutil.move(result / "scene.ply", alone)
    file = small_demo / "figures.json"
    outcome = pocketgs("eval", alone, capture, "--poses-of", result, "--json", file)
    assert (outcome.status, outcome.errors) == (0, "")
    assert json.loads(file.read_text())["psnr"] == pytest.approx(record_of(result)["psnr"], abs=1e-6)
    told = pocketgs("eval", alone, capture).errors
    assert told.startswith(f"warning: {alone}: lies outside a result folder, so that the capture's own poses are used")
    assert told.count("\n") == 1


@pytest.mark.parametrize("command", ["eval", "render", "view", "compress", "distil", "export-colmap"])
def test_poses_are_those_of_a_result_with_cameras(pocketgs: Callable[..., Any], tmp_path: Path, command: str) -> None:
    """Neither a folder nor a scene in one is enough."""
    random_scene(3, 0).save(tmp_path / "scene.ply")
    (tmp_path / "run.json").write_text("{}")
    scene, output = tmp_path / "scene.ply", tmp_path / ("out.pgs" if command == "compress" else "out.ply")
    arguments = {
        "eval": [scene, "capture"],
        "render": [scene, "capture", "--output", tmp_path / "out"],
        "view": [scene, "--capture", "capture"],
        "export-colmap": ["capture", tmp_path / "out"],
    }.get(command, [scene, "capture", "--output", output])
    for named in (tmp_path, scene, tmp_path / "none"):
        outcome = pocketgs(command, *arguments, "--poses-of", named)
        assert (outcome.status, outcome.output) == (2, "")
        assert f"{named}: expected a result folder" in outcome.errors
    if command == "view":
        assert "--poses-of only applies to a capture" in pocketgs("view", scene, "--poses-of", tmp_path).errors


@pytest.mark.parametrize("command", ["compress", "distil"])
def test_work_on_a_scene_outside_its_result_folder(
    pocketgs: Callable[..., Any], small_demo: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    """It uses the run's poses, with a capture or, for renderings, without."""
    shutil.move(small_demo / "result" / "scene.ply", small_demo / "alone.ply")
    poses = [camera.world_to_camera for camera in read_cameras(small_demo / "result" / "cameras.json").cameras.values()]
    used: list[np.ndarray] = []

    def stop(scene: Path, what: Any, doing: str) -> None:
        raise PocketGSError(f"{scene.name}: {doing}")

    def note(scene: Any, cameras: Iterable[Camera], options: Any) -> int:
        used.extend(camera.world_to_camera for camera in cameras)
        return 0

    monkeypatch.setattr(f"pocketgs.cli.commands.{command}.memory_needed", note)
    monkeypatch.setattr(f"pocketgs.cli.commands.{command}.require_memory", stop)
    for capture in ([small_demo / "capture"], []):
        arguments = ["--poses-of", small_demo / "result", "--output", small_demo / "out.pgs"]
        outcome = pocketgs(command, small_demo / "alone.ply", *capture, *arguments)
        assert "alone.ply: " in outcome.errors
        assert used
        assert all(any(np.allclose(one, other) for other in poses) for one in used)
        used.clear()


def test_rendered_views_are_those_of_the_run(pocketgs: Callable[..., Any], small_demo: Path) -> None:
    result, rendered = small_demo / "result", small_demo / "rendered"
    command = ["render", result, small_demo / "capture", "--output", rendered, "--views", "held-out"]
    assert pocketgs(*command).status == 0
    assert names_in(rendered) == names_in(result / "held_out")
    for path in rendered.glob("*.png"):
        pair = np.asarray(Image.open(result / "held_out" / path.name))
        np.testing.assert_array_equal(np.asarray(Image.open(path)), pair[:, 160:])


def test_broken_or_foreign_poses_are_refused(pocketgs: Callable[..., Any], small_demo: Path, tmp_path: Path) -> None:
    result = small_demo / "result"
    poses = (result / "cameras.json").read_text()
    commands = [["eval", result, small_demo / "capture"]]
    commands += [["render", result, small_demo / "capture", "--output", tmp_path / "out"]]
    for content, message in [
        ('{"cameras": ', "cameras.json: not a readable file of cameras"),
        (poses.replace("images/", "photos/"), "cameras.json: names no frame of"),
        (poses.replace("[0.0, 0.0, 0.0, 1.0]", "[0.0, 0.0, 1.0]"), "cameras.json: 'images/"),
    ]:
        (result / "cameras.json").write_text(content)
        for command in commands:
            outcome = pocketgs(*command)
            assert outcome.status == 2
            assert outcome.errors.count("\n") == 1
            assert message in outcome.errors
    assert not (tmp_path / "out").exists()


def test_a_run_with_poses_as_given_says_so(pocketgs: Callable[..., Any], small_demo: Path) -> None:
    options = ["--output", small_demo / "result", "--prior", "sparse", "--no-bundle", "--iterations", 3]
    outcome = pocketgs("train", small_demo / "capture", *options)
    assert (outcome.status, outcome.errors) == (0, "")
    assert "poses as given" in outcome.output
    assert names_in(small_demo / "result") == ["cameras.json", "checkpoint.npz", "held_out", "run.json", "scene.ply"]
    assert not read_cameras(small_demo / "result" / "cameras.json").refined


def test_resumed_run_goes_on_in_the_same_world(pocketgs: Callable[..., Any], small_demo: Path) -> None:
    before, poses = record_of(small_demo / "result"), (small_demo / "result" / "cameras.json").read_bytes()
    options = ["--output", small_demo / "result", "--effort", "quick", "--sh-degree", 1, "--max-gaussians", 3000]
    outcome = pocketgs("train", small_demo / "capture", *options, "--resume", "--iterations", 105)
    assert (outcome.status, outcome.errors) == (0, "")
    after = record_of(small_demo / "result")
    assert (after["resumed_from"], after["iterations"]) == (100, 105)
    assert (small_demo / "result" / "cameras.json").read_bytes() == poses
    assert after["psnr"] > before["psnr"] - 0.5


def test_a_demo_replaces_only_a_demo(
    pocketgs: Callable[..., Any], small_demo: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its own, made by this version or by one that did not record of what, and not the result of another capture."""
    monkeypatch.chdir(small_demo)
    folder, begun = Path("output/demo"), []
    shutil.copytree("result", folder)
    shutil.move("capture", "output/demo-capture")

    def stop(_: object, output: Path, *__: object, source: str, **___: object) -> None:
        begun.append((output, source))
        raise PocketGSError("enough is known")

    monkeypatch.setattr("pocketgs.cli.commands.demo.run", stop)
    own = source_of(Path("output/demo-capture"))
    before = read_manifest(folder)
    for source in (own, None):
        (folder / MANIFEST).write_text(replace(before, source=source).encoded())
        assert "enough is known" in pocketgs("demo").errors
    (folder / MANIFEST).write_text(replace(before, source=source_of(Path("demo"))).encoded())
    assert "output/demo: holds the result of another capture of this name" in pocketgs("demo").errors
    assert begun == [(folder, own)] * 2
    pocketgs("demo", "--output", folder)
    assert len(begun) == 3


def test_demo_folder_of_someone_elses(pocketgs: Callable[..., Any], small_demo: Path) -> None:
    """Neither overwritten nor trained on."""
    other = small_demo / "photos"
    shutil.copytree(small_demo / "capture" / "images", other)
    before = names_in(other)
    outcome = pocketgs("demo", "--output", small_demo / "new", "--capture", other)
    assert outcome.status == 2
    assert "expected a demo's folder or an empty one" in outcome.errors
    assert names_in(other) == before
    assert not (small_demo / "new").exists()
