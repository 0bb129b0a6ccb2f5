"""`.spz` byte by byte: hand-made files of every version, and files with wrong sizes."""

from __future__ import annotations

import gzip
import struct
import sys
import tracemalloc
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pocketgs.cli.commands.convert import convert
from pocketgs.errors import PocketGSError
from pocketgs.scene.formats import spz
from pocketgs.scene.formats.axes import RIGHT_UP_BACK, half_turn
from pocketgs.scene.formats.spz_arrangement import rearranged, with_least_turns
from pocketgs.scene.formats.spz_attributes import fractional_bits_for
from pocketgs.scene.formats.spz_precision import FINE, SMALL
from pocketgs.scene.gaussians import SH_DC, Gaussians
from pocketgs.scene.warning import SceneWarning
from scene.formats.scenes import covariances, opacity_error, random_scene, scenes, turns_between

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd


def header(version: int, count: int = 1, degree: int = 0, bits: int = 12, flags: int = 0, last: int = 0) -> bytes:
    return struct.pack("<IIIBBBB", 0x5053474E, version, count, degree, bits, flags, last)


def streams(version: int, degree: int = 0) -> list[bytes]:
    """Streams of one Gaussian at (1, 2, 3) in our axes, turned by 120 degrees about (1, 1, 1), of opacity 0.5."""
    if version == 1:
        position = struct.pack("<3e", 1, -2, -3)
    else:
        position = b"".join((number * 4096 & 0xFFFFFF).to_bytes(3, "little") for number in (1, -2, -3))
    if version <= 2:
        rotation = bytes([round(127.5 + 63.75), round(127.5 - 63.75), round(127.5 - 63.75)])
    else:
        # x is left out (0); the next three are y, z (negative) and w, each half of the length of 1: 361 of 511.
        rotation = struct.pack("<I", 0 << 30 | (512 | 361) << 20 | (512 | 361) << 10 | 361)
    harmonics = bytes(range(64, 64 + 3 * ((degree + 1) ** 2 - 1)))
    return [position, bytes([128]), bytes([0, 128, 255]), bytes([160, 0, 255]), rotation, harmonics]


def in_gzip(*parts: bytes) -> bytes:
    return gzip.compress(b"".join(parts), mtime=0)


def in_zstd(head: bytes, parts: list[bytes], extension: bytes = b"", sizes: list[int] | None = None) -> bytes:
    packed = [zstd.compress(part) for part in parts]
    sizes = sizes or [len(part) for part in parts]
    rows = b"".join(struct.pack("<QQ", len(each), size) for each, size in zip(packed, sizes, strict=True))
    return b"".join([head, struct.pack("<I12x", 32 + len(extension)), extension, rows, *packed])


def read(tmp_path: Path, contents: bytes) -> Gaussians:
    (tmp_path / "scene.spz").write_bytes(contents)
    return spz.read_gaussians(tmp_path / "scene.spz")


@contextmanager
def little_memory(limit: float = 20e6) -> Iterator[None]:
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < limit
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("version", [1, 2, 3, 4])
@pytest.mark.parametrize("degree", [0, 1, 3, 4])
def test_every_version(tmp_path: Path, version: int, degree: int) -> None:
    parts = streams(version, degree)
    with pytest.warns(SceneWarning, match="degree 4, which are dropped") if degree == 4 else nullcontext():
        if version == 4:
            parts = [part for part in parts if part]
            scene = read(tmp_path, in_zstd(header(4, degree=degree, last=len(parts)), parts))
        else:
            scene = read(tmp_path, in_gzip(header(version, degree=degree), *parts))
    assert scene.means.tolist() == [[1, 2, 3]]
    np.testing.assert_allclose(scene.log_scales, [[0, -10, 5.9375]])
    np.testing.assert_allclose(scene.opacities, 128 / 255, atol=1e-6)
    np.testing.assert_allclose(0.5 + SH_DC * scene.sh[0, 0], 0.5 + SH_DC * np.array([-1, 0, 1]) / 0.3, atol=0.005)
    sign = np.sign(scene.quaternions[0, 0])
    np.testing.assert_allclose(sign * scene.quaternions, [[0.5, 0.5, 0.5, 0.5]], atol=0.01)
    assert scene.sh_degree == min(degree, 3)
    if degree:
        # y and z point the other way in the file, so that of degree 1 (y, z, x) the first two change signs.
        stored = (np.arange(64, 73).reshape(3, 3) - 128) / 128
        np.testing.assert_allclose(scene.sh[0, 1:4], stored * [[-1], [-1], [1]])


@pytest.mark.parametrize("cuts", [(5,), (16,), (20, 21, 30), (35,)])
def test_gzip_of_several_members(tmp_path: Path, cuts: tuple[int, ...]) -> None:
    """Programs that pack in parallel write them, and the page reads them."""
    content = b"".join([header(3), *streams(3)])
    parts = [content[start:end] for start, end in pairwise((0, *cuts, len(content)))]
    members = b"".join(gzip.compress(part, mtime=0) for part in (*parts, b""))
    found = read(tmp_path, members)
    assert found.means.tolist() == [[1, 2, 3]]
    # What follows the last member was never read.
    assert read(tmp_path, members + b"more").means.tolist() == found.means.tolist()
    with pytest.raises(PocketGSError, match="holds more than"):
        read(tmp_path, members + gzip.compress(b"more", mtime=0))
    with pytest.raises(PocketGSError, match="cut short"):
        read(tmp_path, gzip.compress(parts[0], mtime=0))
    with pytest.raises(PocketGSError, match="not a readable gzip stream"):
        read(tmp_path, gzip.compress(parts[0], mtime=0) + b"\x1f\x8b" + bytes(40))


def test_members_that_unpack_to_far_more(tmp_path: Path) -> None:
    packed = gzip.compress(bytes(50_000_000), mtime=0)
    with little_memory(), pytest.raises(PocketGSError, match="holds more than"):
        read(tmp_path, in_gzip(header(3), *streams(3)) + packed)


def test_harmonics_are_turned_with_the_axes(tmp_path: Path) -> None:
    """Colours seen from the same side are equal: the harmonics are evaluated in both axes."""
    from pocketgs.scene.spherical_harmonics import basis

    parts = [part for part in streams(4, 3) if part]
    scene = read(tmp_path, in_zstd(header(4, degree=3, last=6), parts))
    stored = (np.frombuffer(parts[5], np.uint8).reshape(15, 3).astype(np.float64) - 128) / 128
    directions = np.random.default_rng(0).normal(size=(20, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    ours = basis(directions, 16)[:, 1:] @ scene.sh[0, 1:]
    theirs = basis(directions * [1, -1, -1], 16)[:, 1:] @ stored
    np.testing.assert_allclose(ours, theirs, atol=1e-6)


@pytest.mark.parametrize("version", [3, 4])
def test_what_is_written(tmp_path: Path, version: spz.Version) -> None:
    scene = random_scene(10, 1)
    spz.write_gaussians(tmp_path / "scene.spz", scene, version)
    contents = (tmp_path / "scene.spz").read_bytes()
    head = contents if version == 4 else gzip.decompress(contents)
    magic, found, count, degree, bits, flags, last = struct.unpack("<4sIIBBBB", head[:16])
    assert (magic, found, count, degree, flags) == (b"NGSP", version, 10, 1, 0)
    assert last == (6 if version == 4 else 0)
    assert bits == fractional_bits_for(scene, FINE)


def placed(coordinates: list[float], size: float = 1.0) -> Gaussians:
    """Discs of a given size, a tenth as thick, at these positions along x."""
    scene = random_scene(len(coordinates), 0)
    scene.means[:] = np.array(coordinates)[:, None] * [1, 0, 0]
    scene.log_scales[:] = np.log([size, size / 10, size])
    return scene


@pytest.mark.parametrize(("largest", "bits"), [(0.5, 23), (1.0, 22), (0.99, 23), (100.0, 16), (4096.0, 10), (8e6, 0)])
def test_fixed_point_uses_its_24_bits(largest: float, bits: int) -> None:
    assert fractional_bits_for(placed([largest, 0, -largest]), FINE) == bits


@pytest.mark.parametrize(
    ("size", "bits"), [(1.0, 2), (1.01, 2), (0.99, 3), (0.26, 4), (4.1, 0), (100.0, 0), (1e-9, 16)]
)
def test_steps_that_suit_the_size_of_gaussians(size: float, bits: int) -> None:
    """At least four steps in the size of nine in ten Gaussians, if 24 bits suffice."""
    assert fractional_bits_for(placed([-100.0, 100.0], size), SMALL) == bits


@pytest.mark.parametrize(("smaller", "bits"), [(9, 4), (11, 7)])
def test_one_in_ten_gaussians_may_be_smaller(smaller: int, bits: int) -> None:
    scene = placed([100.0] * 100, 0.3)
    scene.log_scales[:smaller] -= np.log(8)
    assert fractional_bits_for(scene, SMALL) == bits


@given(scene=scenes())
def test_least_turns_show_the_same(scene: Gaussians) -> None:
    found = with_least_turns(scene)
    largest = covariances(scene).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(covariances(found) / largest, covariances(scene) / largest, atol=1e-6)
    np.testing.assert_array_equal(np.sort(found.log_scales, axis=1), np.sort(scene.log_scales, axis=1))
    # A cube is never farther from a place that it fills.
    assert (2 * np.degrees(np.arccos(np.minimum(found.quaternions[:, 0], 1)))).max() <= 62.8


@given(scene=scenes(), version=st.sampled_from([3, 4]))
def test_small_keeps_what_it_says(
    tmp_path_factory: pytest.TempPathFactory, scene: Gaussians, version: spz.Version
) -> None:
    path = tmp_path_factory.getbasetemp() / "small.spz"
    spz.write_gaussians(path, scene, version, SMALL)
    found = spz.read_gaussians(path)
    expected = half_turn(rearranged(half_turn(scene, RIGHT_UP_BACK), SMALL), RIGHT_UP_BACK)
    assert sorted(expected.means.tolist()) == sorted(scene.means.tolist())
    assert found.sh.shape == expected.sh.shape
    size = np.exp(np.percentile(np.median(scene.log_scales, axis=1), 10, method="lower"))
    largest = np.abs(scene.means).max()
    assert np.abs(found.means - expected.means).max() <= max(size / 8, largest * 2.0**-23) * 1.001 + largest * 2.0**-24
    assert np.abs(found.log_scales - expected.log_scales).max() <= 1 / 16 + 1e-5
    assert np.abs(found.sh[:, 0] - expected.sh[:, 0]).max() * SH_DC <= 1 / 67
    assert np.abs(found.sh[:, 1:] - expected.sh[:, 1:]).max(initial=0) <= 0.02
    assert opacity_error(found, expected) <= 1 / 63
    assert turns_between(found, expected).max() <= 3


@pytest.mark.parametrize("version", [3, 4])
@pytest.mark.parametrize("degree", [0, 1])
def test_small_is_smaller(version: spz.Version, degree: int) -> None:
    scene = random_scene(5000, degree)
    fine, small = (len(spz.encode(scene, version, precision)) for precision in (FINE, SMALL))
    assert small < 0.85 * fine


def test_scene_that_is_too_large(tmp_path: Path) -> None:
    with pytest.raises(PocketGSError, match=r"scene.*exceeds 8388607"):
        spz.write_gaussians(tmp_path / "scene.spz", random_scene(3, 0, offset=9e6))


@pytest.mark.parametrize("version", [0, 4, 5, 2**31])
def test_unknown_version(tmp_path: Path, version: int) -> None:
    with pytest.raises(PocketGSError, match=f"version {version} in this container, expected 1 or 2 or 3"):
        read(tmp_path, in_gzip(header(version), *streams(3)))


def test_unknown_degree(tmp_path: Path) -> None:
    with pytest.raises(PocketGSError, match="degree 5, expected 0 to 4"):
        read(tmp_path, in_gzip(header(3, degree=5), *streams(3)))


@pytest.mark.parametrize("contents", [b"", b"PK\3\4", b"ply\n", in_gzip(b"ply\nformat ascii 1.0\n")])
def test_wrong_magic(tmp_path: Path, contents: bytes) -> None:
    with pytest.raises(PocketGSError, match=r"scene\.spz: not a \.spz: .*expected b'NGSP'"):
        read(tmp_path, contents)


def test_no_gaussians(tmp_path: Path) -> None:
    with pytest.raises(PocketGSError, match="0 Gaussians"):
        read(tmp_path, in_gzip(header(3, count=0)))


@pytest.mark.parametrize("count", [2, 10**6, 2**32 - 1])
def test_count_beyond_what_is_there(tmp_path: Path, count: int) -> None:
    whole = [part for part in streams(4) if part]
    lying = [len(part) * count for part in whole]
    too_many = "would take" if count == 2**32 - 1 else None
    with little_memory():
        with pytest.raises(PocketGSError, match=too_many or "cut short"):
            read(tmp_path, in_gzip(header(3, count), *streams(3)))
        with pytest.raises(PocketGSError, match=too_many or "bytes, expected"):
            read(tmp_path, in_zstd(header(4, count, last=5), whole))
        with pytest.raises(PocketGSError, match=too_many or "unpacks to"):
            read(tmp_path, in_zstd(header(4, count, last=5), whole, sizes=lying))


def test_stream_that_unpacks_to_far_more_than_stated(tmp_path: Path) -> None:
    compressor = zlib.compressobj(9, wbits=31)
    bomb = b"".join([compressor.compress(header(3) + b"".join(streams(3)))])
    bomb += b"".join(compressor.compress(bytes(10**6)) for _ in range(300)) + compressor.flush()
    parts = [part for part in streams(4) if part]
    sizes = [len(part) for part in parts]
    with little_memory():
        with pytest.raises(PocketGSError, match="holds more than the 20 bytes"):
            read(tmp_path, bomb)
        with zstd.ZstdFile(tmp_path / "zeros", "w") as file:
            for _ in range(300):
                file.write(bytes(10**6))
        packed = [zstd.compress(part) for part in parts[:-1]] + [(tmp_path / "zeros").read_bytes()]
        rows = b"".join(struct.pack("<QQ", len(each), size) for each, size in zip(packed, sizes, strict=True))
        with pytest.raises(PocketGSError, match="unpacks to 5 bytes or more, expected 4"):
            read(tmp_path, b"".join([header(4, last=5), struct.pack("<I12x", 32), rows, *packed]))


@pytest.mark.parametrize("table", [0, 200, 2**32 - 1])
def test_table_of_streams_elsewhere(tmp_path: Path, table: int) -> None:
    contents = bytearray(in_zstd(header(4, last=5), [part for part in streams(4) if part]))
    contents[16:20] = struct.pack("<I", table)
    with pytest.raises(PocketGSError, match=r"scene\.spz"):
        read(tmp_path, bytes(contents))


def test_too_few_streams(tmp_path: Path) -> None:
    with pytest.raises(PocketGSError, match="4 streams, expected 6 for degree 1"):
        read(tmp_path, in_zstd(header(4, degree=1, last=4), streams(4)[:4]))


@pytest.mark.parametrize(
    ("kind", "mean"), [(0, [1, 2, 3]), (4, [1, 2, 3]), (6, [1, -2, -3]), (7, [-1, 2, -3]), (1, [-1, -2, 3])]
)
def test_stated_axes(tmp_path: Path, kind: int, mean: list[float]) -> None:
    """A file states its axes: right or left, down or up, back or forward. Ours are right, down, forward."""
    parts = [part for part in streams(4, 1) if part]
    extension = struct.pack("<III", 0xADBE0003, 4, kind)
    found = read(tmp_path, in_zstd(header(4, degree=1, flags=2, last=6), parts, extension))
    plain = read(tmp_path, in_zstd(header(4, degree=1, last=6), parts))
    assert found.means.tolist() == [mean]
    # Harmonics of degree 1 are those of y, z and x.
    signs = np.array(mean, np.float32) * plain.means[0] / plain.means[0] ** 2
    np.testing.assert_array_equal(found.sh[0, 1:], plain.sh[0, 1:] * signs[[1, 2, 0], None])
    largest = covariances(plain).max()
    turned = np.diag(signs) @ covariances(plain)[0] @ np.diag(signs)
    np.testing.assert_allclose(covariances(found)[0] / largest, turned / largest, atol=1e-6)


def test_upside_down_scene_is_turned_by_convert(tmp_path: Path) -> None:
    """Some programs store the axes of a .ply unchanged; half a turn about x, as docs/formats.md says, rights them."""
    scene = random_scene(50, 3)
    spz.write_gaussians(tmp_path / "theirs.spz", half_turn(scene, RIGHT_UP_BACK))
    convert(tmp_path / "theirs.spz", tmp_path / "upright.ply", rotate=(180.0, 0.0, 0.0))
    found = Gaussians.load(tmp_path / "upright.ply")
    np.testing.assert_allclose(found.means, scene.means, atol=1e-6)
    np.testing.assert_allclose(found.sh, scene.sh, atol=0.015)
    largest = covariances(scene).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(covariances(found) / largest, covariances(scene) / largest, atol=0.1)


def test_extensions(tmp_path: Path) -> None:
    """Unknown extensions are skipped, our own axes accepted, and mirrored ones refused."""
    parts = [part for part in streams(4) if part]
    unknown = struct.pack("<II5s", 0x12340001, 5, b"hello")
    same_axes, other_axes = (struct.pack("<III", 0xADBE0003, 4, axes) for axes in (4, 8))
    head = header(4, flags=2, last=5)
    assert len(read(tmp_path, in_zstd(head, parts, unknown + same_axes))) == 1
    for extension, message in (
        (unknown + other_axes, "expected one of 0, 1, 4, 6, 7: save it with"),
        (unknown[:7], "cut short"),
    ):
        with pytest.raises(PocketGSError, match=message):
            read(tmp_path, in_zstd(head, parts, extension))


def test_extensions_behind_a_gzip_stream(tmp_path: Path) -> None:
    assert len(read(tmp_path, in_gzip(header(3, flags=2), *streams(3), b"whatever"))) == 1
    with pytest.raises(PocketGSError, match="holds more than the 20 bytes"):
        read(tmp_path, in_gzip(header(3), *streams(3), b"whatever"))
