"""The page reads depth maps to the numbers that Python reads."""

from __future__ import annotations

import base64
import io
import struct
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import lzfse
import numpy as np
import OpenEXR
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image
from playwright.sync_api import Error

from pocketgs.capture.decoding.depth_file import read_depth
from pocketgs.capture.frame_parts import reliable_depth
from pocketgs.capture.listing import FrameSource
from pocketgs.geometry.camera import Camera

Call = Callable[..., Any]

READ = """
    const {StoredFile} = await import(new URL("archive/tree.js", location.href));
    const fileOf = ({name, content}) => {
        const bytes = Uint8Array.from(atob(content), (character) => character.charCodeAt(0));
        return new StoredFile(name, bytes.length, async () => bytes);
    };
    const [file, confidence] = [fileOf(given.file), given.confidence && fileOf(given.confidence)];
    const {width, height, values} = await module.readDepth({file, unit: given.unit, confidence, size: given.size});
    return [width, height, [...values]];
"""


def read(
    call: Call,
    path: Path,
    unit: float = 0.001,
    confidence: Path | None = None,
    shape: tuple[int, int] | None = None,
) -> np.ndarray:
    def given(path: Path) -> dict[str, str]:
        return {"name": path.name, "content": base64.b64encode(path.read_bytes()).decode()}

    files = {"file": given(path), "confidence": None if confidence is None else given(confidence)}
    size = None if shape is None else shape[::-1]
    width, height, values = call("capture/depth_map.js", READ, {**files, "unit": unit, "size": size})
    return np.reshape(values, (height, width))


def png(values: np.ndarray, kinds: list[int]) -> bytes:
    """A grey PNG whose lines are predicted in each of these ways in turn, in several chunks of data."""
    step = values.dtype.itemsize
    rows = values.astype(values.dtype.newbyteorder(">")).view(np.uint8).reshape(len(values), -1).astype(int)
    lines = b""
    for number, row in enumerate(rows):
        above = rows[number - 1] if number else np.zeros_like(row)
        left, corner = (np.concatenate([np.zeros(step, int), line[:-step]]) for line in (row, above))
        away = [np.abs(left + above - corner - one) for one in (left, above, corner)]
        nearest = np.select([(away[0] <= away[1]) & (away[0] <= away[2]), away[1] <= away[2]], [left, above], corner)
        kind = kinds[number % len(kinds)]
        predicted = [np.zeros_like(row), left, above, (left + above) // 2, nearest][kind]
        lines += bytes([kind]) + (row - predicted).astype(np.uint8).tobytes()
    header = struct.pack(">IIBBBBB", values.shape[1], len(values), 8 * step, 0, 0, 0, 0)
    packed = zlib.compress(lines)
    chunks = [(b"IHDR", header), (b"IDAT", packed[:9]), (b"IDAT", packed[9:]), (b"IEND", b"")]
    joined = [struct.pack(">I", len(c)) + kind + c + struct.pack(">I", zlib.crc32(kind + c)) for kind, c in chunks]
    return b"\x89PNG\r\n\x1a\n" + b"".join(joined)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_grey_png(call: Call, tmp_path: Path, dtype: type) -> None:
    path = tmp_path / "depth.png"
    values = np.random.default_rng(0).integers(0, np.iinfo(dtype).max, (13, 17), dtype, endpoint=True)
    path.write_bytes(png(values, [0, 1, 2, 3, 4]))
    found = read(call, path)
    np.testing.assert_array_equal(found, read_depth(path, 0.001))
    np.testing.assert_array_equal(found, values.astype(np.float32) * np.float32(0.001))


def test_what_is_not_reliable_is_unknown(call: Call, tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    depth, confidence = tmp_path / "depth.png", tmp_path / "confidence.png"
    Image.fromarray(random.integers(0, 9000, (6, 8), np.uint16)).save(depth)
    Image.fromarray(random.choice(np.array([0, 127, 255], np.uint8), (6, 8))).save(confidence)
    camera = Camera(8, 6, 9.0, 9.0, 4.0, 3.0, np.eye(4))
    source = FrameSource("a", tmp_path, camera, depth_path=depth, confidence_path=confidence)
    np.testing.assert_array_equal(read(call, depth, confidence=confidence), reliable_depth(source))
    Image.fromarray(np.zeros((3, 4), np.uint8)).save(confidence)
    with pytest.raises(Error, match=r"confidence\.png: 4x3 pixels, expected the depth map's 8x6"):
        read(call, depth, confidence=confidence)


@pytest.mark.parametrize("packing", ["NO_COMPRESSION", "ZIPS_COMPRESSION", "ZIP_COMPRESSION"])
@pytest.mark.parametrize("names", ["Z", "R", "BZ", "AR", ("C.A", "C.R", "D.Z")])
@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_exr(call: Call, tmp_path: Path, packing: str, names: Sequence[str], dtype: type) -> None:
    path = tmp_path / "depth.exr"
    random = np.random.default_rng(0)
    channels = {name: random.uniform(-1, 5, (35, 21)).astype(dtype) for name in names}
    channels[names[-1]][:3, :3] = [[np.nan, np.inf, 0]] * 3
    header = {"compression": getattr(OpenEXR, packing), "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(str(path))
    np.testing.assert_array_equal(read(call, path, 1.0), read_depth(path, 1.0))


def test_a_real_exr(call: Call, data_folder: Path) -> None:
    path = min((data_folder / "recordings" / "record3d_exr" / "depth").iterdir())
    found = read(call, path, 1.0)
    assert found.shape == (256, 192)
    np.testing.assert_array_equal(found, read_depth(path, 1.0))


def test_a_real_png(call: Call, data_folder: Path) -> None:
    folder = data_folder / "recordings" / "scanner_app_lowres"
    depth, confidence = folder / "depth_00000.png", folder / "conf_00000.png"
    camera = Camera(256, 192, 200.0, 200.0, 128.0, 96.0, np.eye(4))
    source = FrameSource("a", depth, camera, depth_path=depth, confidence_path=confidence)
    np.testing.assert_array_equal(read(call, depth, confidence=confidence), reliable_depth(source))


@pytest.mark.parametrize("kind", ["<u2", ">u2", "<f4", "<f8", "|u1", "<i4"])
def test_npy(call: Call, tmp_path: Path, kind: str) -> None:
    path = tmp_path / "depth.npy"
    np.save(path, np.random.default_rng(0).uniform(-3, 200, (5, 7)).astype(kind))
    np.testing.assert_array_equal(read(call, path, 0.01), read_depth(path, 0.01))


def depths_of(kind: str, shape: tuple[int, int]) -> np.ndarray:
    """Depth that LZFSE packs in its different ways: stored, as LZVN, in one or in several blocks."""
    random = np.random.default_rng(0)
    smooth = 2 + np.cumsum(random.normal(0, 0.01, shape), axis=1)
    made = {
        "noise": random.uniform(0, 5, shape),
        "smooth": smooth,
        "steps": np.round(smooth, 2),
        "flat": np.ones(shape),
    }
    return made[kind].astype("<f4")


@pytest.mark.parametrize("shape", [(1, 1), (10, 9), (36, 48), (192, 256)])
@pytest.mark.parametrize("kind", ["noise", "smooth", "steps", "flat"])
def test_lzfse(call: Call, tmp_path: Path, kind: str, shape: tuple[int, int]) -> None:
    path = tmp_path / "0.depth"
    path.write_bytes(lzfse.compress(depths_of(kind, shape).tobytes()))
    np.testing.assert_array_equal(read(call, path, 1.0, shape=shape), read_depth(path, 1.0, shape))


UNPACK = """
    const bytesOf = (text) => Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
    return given.map(({packed, size}) => {
        const content = module.unpacked(bytesOf(packed), size);
        return content && btoa([...content].map((byte) => String.fromCharCode(byte)).join(""));
    });
"""


def unpacked(call: Call, files: list[tuple[bytes, int]]) -> list[bytes | None]:
    """Unpack LZFSE files with these declared sizes in the page."""
    given = [{"packed": base64.b64encode(packed).decode(), "size": size} for packed, size in files]
    return [None if one is None else base64.b64decode(one) for one in call("archive/lzfse.js", UNPACK, given)]


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.lists(st.binary(max_size=9).flatmap(lambda piece: st.integers(1, 999).map(lambda n: n * piece))))
def test_any_content_of_lzfse(call: Call, content: list[bytes]) -> None:
    joined = b"".join(content)
    packed = lzfse.compress(joined)
    assert unpacked(call, [(packed, len(joined)), (packed, len(joined) + 1)]) == [joined, None]


def test_damaged_lzfse(call: Call) -> None:
    """Each ends, in the original content or in none of its size."""
    random = np.random.default_rng(0)
    originals = [depths_of(kind, (36, 48)).tobytes() for kind in ("smooth", "steps", "flat")] + [b"word " * 200]
    files = []
    for number in range(2000):
        content = originals[number % 4]
        packed = bytearray(lzfse.compress(content))
        for _ in range(random.integers(1, 4)):
            packed[random.integers(min(len(packed), random.choice([64, 9999])))] = random.integers(256)
        files.append(
            (bytes(packed[: random.integers(4, len(packed) + 1)] if number % 3 == 0 else packed), len(content))
        )
    found = unpacked(call, files)
    assert all(one is None or len(one) == size for one, (_, size) in zip(found, files, strict=True))
    assert sum(one is None for one in found) > 1000


def encoded(image: Image.Image) -> bytes:
    stream = io.BytesIO()
    image.save(stream, "png")
    return stream.getvalue()


GREY = png(np.zeros((9, 9), np.uint16), [0])


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.png", b"", "not a whole JPEG or PNG image"),
        ("a.png", GREY[:60], "cannot be decoded, expected a whole image"),
        ("a.png", png(np.zeros((9, 9), np.uint16), [0]).replace(b"IDAT", b"IDOT"), "cannot be decoded"),
        ("a.png", encoded(Image.new("RGB", (4, 4))), "expected a grey PNG of 8 or 16 bits"),
        ("a.png", encoded(Image.new("1", (4, 4))), "expected a grey PNG of 8 or 16 bits"),
        ("a.exr", b"", "not a readable OpenEXR file"),
        ("a.exr", struct.pack("<II", 20000630, 2) + b"channels\0", "not a readable OpenEXR file"),
        ("a.npy", b"\x93NUMPY\x01\x00\xff\xff{'descr': '<u2'", "not a whole .npy file"),
        ("a.npy", b"", "not a whole .npy file"),
    ],
)
def test_what_is_no_depth_map(call: Call, tmp_path: Path, name: str, content: bytes, words: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(Error, match=rf"{name}: .*{words}"):
        read(call, path)
