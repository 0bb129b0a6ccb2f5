"""Reading videos: frames by number, rotation, and the choice of the sharpest."""

from __future__ import annotations

import struct
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from capture.cut_off_video import film
from capture.phone_layouts import with_quarter_turn
from pocketgs.capture.decoding.video_file import (
    early_end,
    read_frames,
    sharpest_frames,
    sharpness_of_frames,
    video_size,
)
from pocketgs.capture.sharpness import sharpest_in_windows, sharpness
from pocketgs.errors import PocketGSError
from pocketgs.results.video import write_video

COUNT, HEIGHT, WIDTH = 12, 48, 64
SHARP = (2, 4, 9)


def textured(number: int) -> np.ndarray:
    """A frame whose top left shows its number as a grey level, above a texture that is sharp in SHARP's frames only."""
    texture = np.random.default_rng(0).integers(0, 256, (HEIGHT // 4, WIDTH // 4, 3), dtype=np.uint8)
    frame = cv2.resize(texture, (WIDTH, HEIGHT), interpolation=cv2.INTER_NEAREST)
    if number not in SHARP:
        frame = cv2.GaussianBlur(frame, (0, 0), 3)
    frame[:16, :16] = 20 * number
    return frame


def number_of(frame: np.ndarray) -> int:
    return round(float(frame[4:12, 4:12].mean()) / 20)


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("video") / "a: walk.mp4"
    write_video(path, map(textured, range(COUNT)), fps=24)
    return path


def test_size(video):
    assert video_size(video) == (WIDTH, HEIGHT)


@pytest.mark.parametrize("indices", [[0], [3, 4, 11], [7, 2, 7], range(COUNT), []])
def test_frames_come_by_number_in_ascending_order(video, indices):
    found = list(read_frames(video, indices))
    assert [index for index, _ in found] == sorted(set(indices))
    for index, frame in found:
        assert number_of(frame) == index
        assert frame.shape == (HEIGHT, WIDTH, 3)
        assert frame.dtype == np.uint8


def test_colours_are_rgb(tmp_path):
    red = np.zeros((32, 32, 3), np.uint8) + np.array([230, 20, 20], np.uint8)
    write_video(tmp_path / "red.mp4", [red])
    [(_, frame)] = read_frames(tmp_path / "red.mp4", [0])
    np.testing.assert_allclose(frame.mean(axis=(0, 1)), [230, 20, 20], atol=8)


def test_a_video_that_asks_to_be_turned_is(video, tmp_path):
    turned = tmp_path / "portrait.mp4"
    turned.write_bytes(with_quarter_turn(video.read_bytes(), HEIGHT))
    assert video_size(turned) == (HEIGHT, WIDTH)
    [(_, stored)], [(_, upright)] = read_frames(video, [5]), read_frames(turned, [5])
    np.testing.assert_array_equal(upright, np.rot90(stored, -1))
    [(_, unturned)] = read_frames(turned, [5], upright=False)
    np.testing.assert_array_equal(unturned, stored)
    assert video_size(turned, upright=False) == (WIDTH, HEIGHT)


def test_the_sharpest_of_each_window(video):
    assert sharpest_frames(video, 3) == list(SHARP)
    assert set(SHARP[1:]) <= set(sharpest_frames(video, 6))
    assert sharpest_frames(video, COUNT) == sharpest_frames(video, 1000) == list(range(COUNT))


@given(st.lists(st.floats(0, 1), min_size=1, max_size=50), st.integers(1, 60))
def test_one_of_each_window(values, count):
    chosen = sharpest_in_windows(values, count)
    assert len(chosen) == min(count, len(values))
    assert chosen == sorted(set(chosen))
    assert max(values) in [values[index] for index in chosen]
    longest = -(-len(values) // len(chosen))
    assert np.diff([-1, *chosen, len(values)]).max() < 2 * longest + 1


def test_blur_lowers_sharpness():
    assert sharpness(textured(SHARP[0])[:, :, 1]) > sharpness(textured(0)[:, :, 1])
    assert sharpness(np.full((1, 3000), 7, np.uint8)) == 0


@pytest.mark.parametrize(
    "read", [video_size, lambda path: list(read_frames(path, [0])), lambda path: sharpest_frames(path, 3)]
)
@pytest.mark.parametrize("content", [None, b"", b"no video at all", b"\0\0\0\x18ftypmp42\0\0\0\0mp42isom"])
def test_what_is_no_video_is_named(tmp_path, read, content):
    path = tmp_path / "walk.mp4"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(PocketGSError, match=r"walk\.mp4"):
        read(path)


def with_matrix(mp4: bytes, numbers: list[int]) -> bytes:
    """A video with another track matrix (ISO 14496-12, 8.3.2)."""
    start = mp4.index(b"tkhd") + 4 + 40
    return mp4[:start] + struct.pack(">9i", *numbers) + mp4[start + 36 :]


@pytest.mark.parametrize("numbers", [[0] * 9, [20000, 62000, 0, -62000, 20000, 0, 0, 0, 1 << 30]])
def test_a_matrix_that_is_no_quarter_turn_is_ignored(video, tmp_path, numbers):
    other = tmp_path / "tilted.mp4"
    other.write_bytes(with_matrix(video.read_bytes(), numbers))
    assert video_size(other) == (WIDTH, HEIGHT)
    [(_, frame)], [(_, expected)] = read_frames(other, [3]), read_frames(video, [3])
    np.testing.assert_array_equal(frame, expected)


def test_frames_end_where_the_video_is_damaged(tmp_path):
    """Frames after it would have wrong numbers: recordings of phone apps refer to frames by number."""
    path = tmp_path / "damaged.mkv"
    with av.open(str(path), "w") as file:
        stream = file.add_stream("ffv1", rate=30)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for number in range(COUNT):
            for packet in stream.encode(av.VideoFrame.from_ndarray(textured(number), format="rgb24")):
                if number == 5:
                    packet = av.Packet(b"\xff" * 8)
                    packet.stream, packet.pts, packet.dts, packet.time_base = stream, 5, 5, Fraction(1, 30)
                file.mux(packet)
    assert len(sharpness_of_frames(path)) == 5
    assert [number_of(frame) for _, frame in read_frames(path, range(5))] == list(range(5))
    with pytest.raises(PocketGSError, match="frame 7 cannot be decoded, the video ends after 5 frames"):
        list(read_frames(path, [7]))


def ninety_frames() -> list[np.ndarray]:
    return [textured(number % COUNT) for number in range(90)]


@pytest.mark.parametrize("name", ["walk.mp4", "walk.mkv"])
@pytest.mark.parametrize("share", [1.0, 0.98, 0.5])
def test_a_video_that_was_not_transferred_as_a_whole(tmp_path, name, share):
    """A header that overstates by a few frames is no reason to warn."""
    path, warnings = tmp_path / name, list[str]()
    content = film(path, ninety_frames())
    path.write_bytes(content[: int(share * len(content))])
    read = len(sharpest_frames(path, 1000, warnings.append))
    if share < 0.9:
        assert 20 <= read <= 60
        [warning] = warnings
        assert f"{name}: is damaged or not there as a whole, and ends after {read} of 90 frames: copy it" in warning
        assert " of 90 frames: copy it" in early_end(path)
    else:
        assert read >= 85
        assert (warnings, early_end(path)) == ([], "")


def test_damage_inside_a_video_is_told(tmp_path):
    path, warnings = tmp_path / "walk.mp4", list[str]()
    content = bytearray(film(path, ninety_frames(), "libx264"))
    start = content.index(b"mdat") + (len(content) - content.index(b"mdat")) // 2
    content[start : start + 3000] = np.random.default_rng(1).bytes(3000)
    path.write_bytes(content)
    read = len(sharpest_frames(path, 1000, warnings.append))
    assert early_end(path) == ""
    assert [f"ends after {read} of 90 frames" in warning for warning in warnings] == [True]


def test_a_trimmed_video_is_whole(tmp_path):
    """Phones leave the frames before the cut in the file, and let an edit list begin after them."""
    path, warnings = tmp_path / "walk.mp4", list[str]()
    content = bytearray(film(path, ninety_frames()))
    first = content.index(b"elst") + 12
    length, begin = struct.unpack(">ii", content[first : first + 8])
    struct.pack_into(">ii", content, first, length // 3, begin + 2 * 30 * 512)
    path.write_bytes(content)
    assert len(sharpest_frames(path, 1000, warnings.append)) == 30
    assert (warnings, early_end(path)) == ([], "")


def test_a_cover_before_the_video(tmp_path):
    path = tmp_path / "walk.mkv"
    with av.open(str(path), "w") as file:
        cover, stream = file.add_stream("mjpeg", rate=1), file.add_stream("mpeg4", rate=30)
        for each, (width, height) in ((cover, (32, 24)), (stream, (WIDTH, HEIGHT))):
            each.width, each.height = width, height
            each.pix_fmt = "yuvj420p" if each is cover else "yuv420p"
        file.mux(cover.encode(av.VideoFrame.from_ndarray(textured(0)[:24, :32].copy(), format="rgb24")))
        for number in range(COUNT):
            file.mux(stream.encode(av.VideoFrame.from_ndarray(textured(number), format="rgb24")))
        file.mux([*cover.encode(None), *stream.encode(None)])
    assert video_size(path) == (WIDTH, HEIGHT)
    assert len(sharpness_of_frames(path)) == COUNT
    assert early_end(path) == ""


def test_a_lack_of_memory_is_not_the_end_of_a_video(video, monkeypatch):
    """FFmpeg reports it like damage, but fewer frames must not be taken for all."""

    class LackingMemory:
        def __init__(self, file):
            self.streams = file.streams

        def decode(self, stream):
            yield av.VideoFrame(WIDTH, HEIGHT, "yuv420p")
            raise av.error.MemoryError(12, "Cannot allocate memory")

    @contextmanager
    def opened(path):
        with av.open(str(path)) as file:
            yield LackingMemory(file)

    monkeypatch.setattr("pocketgs.capture.decoding.video_file._opened", opened)
    with pytest.raises(MemoryError):
        sharpness_of_frames(video)


@pytest.mark.parametrize("codec", [b"encv", b"xyz1"])
def test_a_codec_without_decoder_is_named(video, tmp_path, codec):
    path = tmp_path / "locked.mp4"
    path.write_bytes(video.read_bytes().replace(b"avc1", codec))
    for read in (video_size, sharpness_of_frames, lambda path: list(read_frames(path, [0]))):
        with pytest.raises(PocketGSError, match=r"locked\.mp4: (cannot be opened as a video|.*can(not)? be decoded)"):
            read(path)


@pytest.mark.parametrize("indices", [[COUNT], [0, 5, 1000], [-1]])
def test_frames_that_do_not_exist(video, indices):
    with pytest.raises(PocketGSError, match=rf"walk\.mp4: frame {max(indices, key=abs)} cannot be decoded"):
        list(read_frames(video, indices))


def test_a_count_of_none(video):
    with pytest.raises(PocketGSError, match="expected at least 1"):
        sharpest_frames(video, 0)
