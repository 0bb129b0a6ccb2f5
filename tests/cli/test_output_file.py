"""What commands that write one file replace, and what they leave alone."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from plyfile import PlyData, PlyElement

from cli.conftest import Outcome
from pocketgs.cli.output_file import SCENE_FILE, VIDEO_FILE, check_place, make_writable
from pocketgs.errors import PocketGSError
from pocketgs.results.video import write_video
from pocketgs.scene.formats import FORMATS, write_scene
from scene.formats.scenes import random_scene

FRAMES = [np.full((16, 16, 3), 90, np.uint8)] * 2


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """A file with a scene."""
    path = tmp_path / "scene.ply"
    random_scene(10, 0).save(path)
    return path


@pytest.mark.parametrize("suffix", [suffix for each in FORMATS for suffix in each.suffixes if suffix != ".gltf"])
def test_a_scene_replaces_a_scene_of_its_format(tmp_path: Path, scene: Path, suffix: str) -> None:
    output = tmp_path / f"out{suffix}"
    write_scene(output, random_scene(10, 0))
    check_place(output, SCENE_FILE, [scene])
    output.write_text("minutes of the meeting")
    with pytest.raises(PocketGSError, match="is there already and not a scene, so that it is not replaced"):
        check_place(output, SCENE_FILE, [scene])
    output.write_bytes(b"")
    check_place(output, SCENE_FILE, [scene])


def test_a_cloud_of_points_is_no_scene(tmp_path: Path, scene: Path, pocketgs: Callable[..., Outcome]) -> None:
    points = np.zeros(3, [("x", "f4"), ("y", "f4"), ("z", "f4")])
    PlyData([PlyElement.describe(points, "vertex")]).write(str(tmp_path / "cloud.ply"))
    before = (tmp_path / "cloud.ply").read_bytes()
    outcome = pocketgs("convert", scene, tmp_path / "cloud.ply")
    assert outcome.status == 2
    assert "cloud.ply: is there already and not a scene" in outcome.errors
    assert (tmp_path / "cloud.ply").read_bytes() == before


def test_the_scene_that_is_read_stays(tmp_path: Path, scene: Path, pocketgs: Callable[..., Outcome]) -> None:
    before = scene.read_bytes()
    (tmp_path / "link.ply").symlink_to(scene)
    for output in (scene, tmp_path / "link.ply"):
        outcome = pocketgs("convert", scene, output, "--scale", 2)
        assert outcome.status == 2
        assert "is what the command reads, expected another name for the output" in outcome.errors
    assert scene.read_bytes() == before


def test_a_folder_that_cannot_be_written_to_is_known_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = tmp_path / "new" / "out.ply"
    make_writable(output.parent)
    check_place(output, SCENE_FILE, [])
    assert list(output.parent.iterdir()) == []

    def refuse(*_: Any, **__: Any) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "touch", refuse)
    with pytest.raises(PocketGSError, match=r"out\.ply: cannot be written \(Permission denied\)"):
        check_place(output, SCENE_FILE, [])
    monkeypatch.setattr(Path, "mkdir", refuse)
    with pytest.raises(PocketGSError, match=r"new: cannot be made \(Permission denied\)"):
        make_writable(output.parent)


def test_figures_are_written_though_nobody_reads_the_table(
    result: Path, written_capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pocketgs: Callable[..., Any]
) -> None:
    def closed(*_: object) -> None:
        raise BrokenPipeError(32, "Broken pipe")

    monkeypatch.setattr("pocketgs.cli.commands.evaluate.print_evaluation", closed)
    assert pocketgs("eval", result, written_capture, "--json", tmp_path / "figures.json").status == 2
    assert json.loads((tmp_path / "figures.json").read_text())["psnr"] > 0


@pytest.mark.parametrize("command", ["convert", "distil", "eval", "compress"])
def test_files_of_a_result_stay(
    tmp_path: Path, result: Path, scene: Path, pocketgs: Callable[..., Any], command: str
) -> None:
    """They belong together; files that are put beside them may be replaced."""
    arguments = {
        "convert": [scene, result / "scene.ply"],
        "distil": [scene, "--output", result / "scene.ply"],
        "eval": [result, "capture", "--json", result / "run.json"],
        "compress": [scene, "--output", tmp_path / "new.pgs", "--json", result / "cameras.json"],
    }[command]
    outcome = pocketgs(command, *arguments)
    assert outcome.status == 2
    assert f"belongs to the result in {result}, expected another name for the output" in outcome.errors
    shutil.copy(scene, result / "mine.ply")
    assert pocketgs("convert", scene, result / "mine.ply").status == 0


def test_videos(tmp_path: Path) -> None:
    write_video(tmp_path / "orbit.mp4", FRAMES)
    check_place(tmp_path / "orbit.mp4", VIDEO_FILE, [])
    with pytest.raises(PocketGSError, match="is what the command reads"):
        check_place(tmp_path / "orbit.mp4", VIDEO_FILE, [tmp_path / "orbit.mp4"])
    film = cv2.VideoWriter(str(tmp_path / "film.mp4"), cv2.VideoWriter.fourcc(*"MJPG"), 30, (16, 16))
    film.write(FRAMES[0])
    film.release()
    with pytest.raises(PocketGSError, match="not a video that this version of render wrote"):
        check_place(tmp_path / "film.mp4", VIDEO_FILE, [])


def test_render_does_not_replace_a_film(
    tmp_path: Path, result: Path, written_capture: Path, pocketgs: Callable[..., Outcome]
) -> None:
    (tmp_path / "film.mp4").write_text("a film")
    outcome = pocketgs("render", result, written_capture, "--output", tmp_path / "film.mp4", "--frames", 2)
    assert outcome.status == 2
    assert "not a video that this version of render wrote" in outcome.errors
    assert (tmp_path / "film.mp4").read_text() == "a film"


def test_figures_replace_figures_only(
    result: Path, capture_folder: Path, tmp_path: Path, pocketgs: Callable[..., Outcome]
) -> None:
    figures, poses = tmp_path / "figures.json", capture_folder / "transforms.json"
    for _ in range(2):
        assert pocketgs("eval", result, capture_folder, "--json", figures).status == 0
    for file, message in [(poses, "not figures of eval"), (tmp_path / "no/a.json", "its folder does not exist")]:
        outcome = pocketgs("eval", result, "capture that is not read", "--json", file)
        assert outcome.status == 2
        assert message in outcome.errors
    assert "frames" in json.loads(poses.read_text())
