"""Videos can be read back, and errors leave no file behind."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from pocketgs.errors import PocketGSError
from pocketgs.results.video import write_video


def grey_frames(count: int, height: int = 48, width: int = 64) -> list[np.ndarray]:
    """Frames that brighten, with a red left half."""
    frames = [np.full((height, width, 3), 40 + 20 * number, np.uint8) for number in range(count)]
    for frame in frames:
        frame[:, : width // 2] = (220, 30, 30)
    return frames


def read_back(path: Path) -> tuple[list[np.ndarray], float]:
    reader = cv2.VideoCapture(str(path))
    frames = []
    while True:
        found, frame = reader.read()
        if not found:
            return frames, reader.get(cv2.CAP_PROP_FPS)
        frames.append(cv2.cvtColor(frame, cv2.COLOR_BGR2RGB))


def test_reads_back(tmp_path: Path) -> None:
    path = tmp_path / "orbit.mp4"
    written = grey_frames(6)
    write_video(path, iter(written), fps=24)
    frames, fps = read_back(path)
    assert fps == pytest.approx(24)
    assert len(frames) == 6
    for frame, original in zip(frames, written, strict=True):
        assert np.abs(frame.astype(int) - original).mean() < 6
    assert [entry.name for entry in tmp_path.iterdir()] == ["orbit.mp4"]


def test_odd_sizes_lose_a_row_and_a_column(tmp_path: Path) -> None:
    write_video(tmp_path / "odd.mp4", grey_frames(2, 33, 51))
    frames, _ = read_back(tmp_path / "odd.mp4")
    assert frames[0].shape == (32, 50, 3)


def failing_frames(count: int):
    yield from grey_frames(count)
    raise PocketGSError("rendering failed")


def test_failure_keeps_the_old_video(tmp_path: Path) -> None:
    path = tmp_path / "orbit.mp4"
    path.write_bytes(b"old")
    with pytest.raises(PocketGSError, match="rendering failed"):
        write_video(path, failing_frames(2))
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("name", "frames", "fps", "message"),
    [
        ("a.avi", grey_frames(1), 30, "ends in .mp4, found .avi"),
        ("absent/a.mp4", grey_frames(1), 30, "no folder"),
        ("a.mp4", [], 30, "no frames"),
        ("a.mp4", grey_frames(1), 0, "found 0, expected 0.1"),
        ("a.mp4", grey_frames(1), float("inf"), "found inf, expected 0.1"),
        ("a.mp4", [np.zeros((48, 64, 3))], 30, "frame 0 is float64"),
        ("a.mp4", grey_frames(1) + grey_frames(1, 24, 64), 30, "frame 1 has size"),
    ],
)
def test_what_cannot_be_written_is_named(
    tmp_path: Path, name: str, frames: list[np.ndarray], fps: float, message: str
) -> None:
    with pytest.raises(PocketGSError, match=message):
        write_video(tmp_path / name, frames, fps)
    assert list(tmp_path.iterdir()) == []


def test_target_that_is_a_folder(tmp_path: Path) -> None:
    (tmp_path / "a.mp4").mkdir()
    with pytest.raises(PocketGSError, match="cannot be written"):
        write_video(tmp_path / "a.mp4", grey_frames(1))
