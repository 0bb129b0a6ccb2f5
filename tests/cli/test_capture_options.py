"""What all commands print about a capture."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from pocketgs.cli.capture_options import CaptureOptions


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


@pytest.mark.parametrize("name", [None, "cat.png"])
def test_masks_that_no_frame_of_a_video_has_are_refused_at_once(
    pocketgs: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str | None
) -> None:
    monkeypatch.setattr("pocketgs.cli.train.posed", lambda *_, **__: pytest.fail("poses are sought"))
    video, masks = tmp_path / "room.mp4", tmp_path / "people"
    video.touch()
    if name is not None:
        masks.mkdir()
        Image.new("L", (8, 6), 255).save(masks / name)
    refused = pocketgs("train", video, "--output", tmp_path / "result", "--masks", masks)
    assert refused.status == 2
    assert f"{masks}: holds no mask of a frame of {video}, expected such as frame_000120.png" in refused.errors


@pytest.mark.parametrize("name", ["frame_000012.jpg.png", "frame_000012.png", "12.png"])
def test_masks_that_may_be_of_a_videos_frames(tmp_path: Path, name: str) -> None:
    (tmp_path / "room.mp4").touch()
    (tmp_path / "people").mkdir()
    Image.new("L", (8, 6), 255).save(tmp_path / "people" / name)
    for masks in (str(tmp_path / "people"), "inside-the-capture-that-is-made"):
        CaptureOptions(masks=masks).check_without_poses(tmp_path / "room.mp4")
