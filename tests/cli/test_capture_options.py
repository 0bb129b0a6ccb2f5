"""What all commands print about a capture."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from pocketgs.capture.options import CaptureOptions
from pocketgs.cli.capture_options import check_without_poses


@pytest.fixture
def no_poses(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fail where structure from motion would begin."""
    monkeypatch.setattr("pocketgs.cli.commands.train.pose_once", lambda *_, **__: pytest.fail("poses are sought"))


def test_warnings_and_masks_are_told(pocketgs: Callable, capture_folder: Path, tmp_path: Path) -> None:
    images = sorted((capture_folder / "images").iterdir())
    for image in images[1:4]:
        (capture_folder / "masks").mkdir(exist_ok=True)
        Image.new("L", (48, 36), 255).save(capture_folder / "masks" / f"{image.name}.png")
    images[-1].unlink()
    exported = pocketgs("export-colmap", capture_folder, tmp_path / "colmap")
    assert exported.status == 0
    assert "warning: " in exported.errors
    assert "1 of 8 listed frames have no image file" in exported.errors
    assert "no masks for 4 of 7 frames" in exported.errors
    told = pocketgs("info", capture_folder)
    assert "masks for 3 of 7" in told.output
    assert told.output.count("no masks for 4 of 7 frames") == 1
    assert "masks for" not in pocketgs("info", capture_folder, "--masks", "none").output
    refused = pocketgs("info", capture_folder, "--masks", "nowhere")
    assert (refused.status, "nowhere: no such folder" in refused.errors) == (2, True)


@pytest.mark.parametrize("given", ["clip/room.mp4", "clip"])
@pytest.mark.parametrize("names", [[], ["cat.png"]])
def test_masks_that_no_frame_of_a_video_has_are_refused_at_once(
    pocketgs: Callable, tmp_path: Path, no_poses: None, names: list[str], given: str
) -> None:
    """A folder stands for the only video in it."""
    video, masks = tmp_path / "clip/room.mp4", tmp_path / "people"
    video.parent.mkdir()
    video.touch()
    masks.mkdir()
    for name in names:
        Image.new("L", (8, 6), 255).save(masks / name)
    refused = pocketgs("train", tmp_path / given, "--output", tmp_path / "result", "--masks", masks)
    assert refused.status == 2
    assert f"{masks}: holds no mask of a frame of {video}, expected such as frame_000120.png" in refused.errors


@pytest.mark.parametrize("source", ["room.mp4", "photographs"])
@pytest.mark.parametrize("is_relative", [True, False])
def test_masks_that_are_not_there_are_refused_at_once(
    pocketgs: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_poses: None, source: str, is_relative: bool
) -> None:
    """A mistyped folder is named, with where a relative one was looked for, before poses are sought for minutes."""
    monkeypatch.chdir(tmp_path)
    Path("room.mp4").touch()
    Path("photographs").mkdir()
    for number in range(3):
        Image.new("RGB", (64, 48)).save(f"photographs/{number}.jpg")
    masks = "peeple" if is_relative else str(tmp_path / "peeple")
    refused = pocketgs("train", source, "--output", "result", "--masks", masks)
    assert refused.status == 2
    assert f"{masks}: no such folder, expected one with masks" in refused.errors
    searched = Path("result/posed/room") if source == "room.mp4" else Path("photographs")
    assert (f" in the current folder or in {searched}" in refused.errors) == is_relative
    assert "structure from motion" not in refused.output
    assert not Path("result").exists()


def test_named_masks_of_photographs_without_poses_are_not_ignored(
    pocketgs: Callable, capture_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Though the capture that is made of the photographs has copies of them, which look as if they were found there."""
    photographs, people = tmp_path / "photographs", tmp_path / "people"
    shutil.copytree(capture_folder / "images", photographs)
    (capture_folder / "masks").mkdir()
    people.mkdir()
    for image in photographs.iterdir():
        for folder in (people, capture_folder / "masks"):
            Image.new("L", (72, 96), 255).save(folder / f"{image.name}.png")
    monkeypatch.setattr("pocketgs.cli.commands.train.pose_once", lambda *_, **__: capture_folder)
    refused = pocketgs("train", photographs, "--output", tmp_path / "result", "--masks", people)
    assert refused.status == 2
    assert "mask of 72x96 pixels, expected the shape of its photograph, 96x72" in refused.errors


@pytest.mark.parametrize("masks", ["found", "none", "people"])
@pytest.mark.parametrize("name", ["frame_000012.jpg.png", "frame_000012.png", "12.png"])
def test_masks_that_may_be_of_a_videos_frames(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, masks: str, name: str
) -> None:
    """Wherever they are: in the current folder, or in the capture that an earlier run has made."""
    monkeypatch.chdir(tmp_path)
    video, made = tmp_path / "room.mp4", tmp_path / "made"
    video.touch()
    for place in (tmp_path, made):
        (place / "people").mkdir(parents=True)
        Image.new("L", (8, 6), 255).save(place / "people" / name)
        check_without_poses(CaptureOptions(masks=masks), video, made)
        check_without_poses(CaptureOptions(masks=str(place / "people")), video, made)
        shutil.rmtree(place / "people")


@pytest.mark.usefixtures("no_poses")
def test_photographs_without_masks_are_not_cut_out(pocketgs: Callable, tmp_path: Path) -> None:
    """Found before poses are, which takes minutes."""
    for number in range(3):
        Image.new("RGB", (8, 6)).save(tmp_path / f"{number}.png")
    done = pocketgs("train", tmp_path, "--output", tmp_path / "out", "--outside-masks", "empty")
    assert done.status != 0
    assert "has no masks, outside which it could be empty" in done.errors


@pytest.mark.usefixtures("no_poses")
@pytest.mark.parametrize("masks", ["found", "none"])
def test_a_video_without_masks_is_not_cut_out(pocketgs: Callable, tmp_path: Path, masks: str) -> None:
    """Its frames can only have those that are named, or were put beside an earlier run's."""
    (tmp_path / "room.mp4").touch()
    options = ["--output", tmp_path / "out", "--outside-masks", "empty", "--masks", masks]
    done = pocketgs("train", tmp_path / "room.mp4", *options)
    assert done.status != 0
    assert "has no masks, outside which it could be empty" in done.errors
