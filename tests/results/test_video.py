"""Videos can be read back, and errors leave no file behind."""

from __future__ import annotations

from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from pocketgs.errors import PocketGSError
from pocketgs.results.video import is_written_video, write_video


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


def test_plays_on_phones_and_in_browsers(tmp_path: Path) -> None:
    write_video(tmp_path / "orbit.mp4", grey_frames(6), fps=29.97)
    with av.open(str(tmp_path / "orbit.mp4")) as file:
        stream = file.streams.video[0]
        assert stream.codec_context.name == "h264"
        assert stream.codec_context.pix_fmt == "yuv420p"
        assert float(stream.average_rate) == pytest.approx(29.97)


def test_written_videos_are_told_from_others(tmp_path: Path) -> None:
    write_video(tmp_path / "orbit.mp4", grey_frames(2))
    assert is_written_video(tmp_path / "orbit.mp4")
    written = (tmp_path / "orbit.mp4").read_bytes()
    (tmp_path / "phone.mp4").write_bytes(written.replace(b"rendered", b"recorded"))
    assert not is_written_video(tmp_path / "phone.mp4")
    (tmp_path / "empty.mp4").write_bytes(b"no video")
    with pytest.raises(PocketGSError, match=r"empty\.mp4: cannot be opened as a video"):
        is_written_video(tmp_path / "empty.mp4")


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
        ("a.mp4", grey_frames(1, 2, 17000), 30, "cannot be written as H.264 video"),
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
