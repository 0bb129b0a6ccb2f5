"""`pocketgs info` on photographs and videos without poses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from capture.cut_off_video import write_cut_off


@pytest.fixture
def photographs(tmp_path: Path) -> Path:
    folder = tmp_path / "walk"
    folder.mkdir()
    exif = Image.Exif()
    exif[0x0110] = "Phone 7"
    exif.get_ifd(0x8769)[0xA405] = 26
    for index in range(5):
        size, options = ((40, 30), {"exif": exif}) if index else ((30, 40), {})
        Image.new("RGB", size).save(folder / f"{index}.jpg", **options)
    return folder


def test_photographs(pocketgs: Callable[..., Any], photographs: Path) -> None:
    (photographs / "5.jpg").write_bytes(b"")
    outcome = pocketgs("info", photographs)
    assert outcome.status == 0
    assert outcome.output.splitlines() == [
        "walk: 6 photographs without poses",
        "sizes in pixels: 40x30 (4), 30x40 (1)",
        "EXIF: Phone 7 (4), no camera (1); focal length in 4, GPS in 0",
        "warning: cannot be decoded: 5.jpg",
        "train finds poses by structure from motion, and so does pose",
    ]


def test_damaged_photographs_alone(pocketgs: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_bytes(b"")
    outcome = pocketgs("info", tmp_path)
    assert outcome.status == 0
    assert "1 photograph without poses\nsizes in pixels: none\nEXIF: none; " in outcome.output


def test_a_video_that_was_cut_off(pocketgs: Callable[..., Any], tmp_path: Path) -> None:
    video = tmp_path / "walk.mp4"
    write_cut_off(video)
    [size, warning, _] = pocketgs("info", video).output.splitlines()
    assert size == "walk: a video of 64x48 pixels, without poses"
    assert warning.startswith(f"warning: {video}: is damaged or not there as a whole, and ends after ")
    assert " of 90 frames: copy it from the camera again" in warning


def test_a_video(pocketgs: Callable[..., Any], tmp_path: Path) -> None:
    """Named itself, or by its folder."""
    video = cv2.VideoWriter(str(tmp_path / "walk.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 30, (64, 48))
    for level in range(3):
        video.write(np.full((48, 64, 3), level, np.uint8))
    video.release()
    for path in (tmp_path / "walk.avi", tmp_path):
        outcome = pocketgs("info", path)
        assert outcome.output.startswith("walk: a video of 64x48 pixels, without poses\n")
