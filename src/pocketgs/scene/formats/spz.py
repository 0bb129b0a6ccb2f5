"""Niantic's `.spz`: about a tenth of the size of a `.ply` of degree 3, in axes x right, y up, z back.

Version 4 is a plain header, a table of streams and the streams, each compressed with Zstandard. Versions 1 to 3 are one
gzip stream that starts with a shorter header. `spz_attributes.py` defines the streams' contents, `spz_precision.py` how
coarsely we round, and `spz_arrangement.py` how Gaussians are reordered to compress better.
"""

from __future__ import annotations

import struct
import sys
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from pocketgs.errors import PocketGSError
from pocketgs.files.atomic_file import replacing
from pocketgs.scene.formats import antialiased
from pocketgs.scene.formats.axes import LEFT_DOWN_BACK, LEFT_UP_FORWARD, RIGHT_DOWN_FORWARD, RIGHT_UP_BACK, half_turn
from pocketgs.scene.formats.checks import (
    read_contents,
    require_any,
    require_room,
    require_sound,
    warn_of_degree_4,
)
from pocketgs.scene.formats.coarseness import is_coarse, warn_if_coarse
from pocketgs.scene.formats.gzip_members import MAGIC as GZIP_MAGIC
from pocketgs.scene.formats.gzip_members import WINDOW, GzipMembers
from pocketgs.scene.formats.spz_arrangement import rearranged
from pocketgs.scene.formats.spz_attributes import MAX_FIXED, Layout, fractional_bits_for, pack, unpack
from pocketgs.scene.formats.spz_precision import FINE, Precision
from pocketgs.scene.formats.spz_range import exceeds_range, warn_of_range
from pocketgs.scene.gaussians import Gaussians

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

Version: TypeAlias = Literal[3, 4]
CURRENT: Version = 4

MAGIC = b"NGSP"
HEADER = struct.Struct("<4sIIBBBB")
"""Magic, version, count, SH degree, fractional bits, flags, and in version 4 the number of streams."""

TABLE_START = struct.Struct("<I12x")
"""Fields that version 4 adds to the header: the offset of the table of streams."""

TABLE_ROW = struct.Struct("<QQ")
"""A stream's compressed and original size."""

EXTENSION = struct.Struct("<II")
"""An extension's type and size."""

FIRST_ROW = HEADER.size + TABLE_START.size
STREAMS = 6
MAX_DEGREE = 4
ANTIALIASED, HAS_EXTENSIONS = 1, 2
"""Bits of the flags."""

AXES_EXTENSION = 0xADBE0003
"""Adobe's extension that states a file's axes, which are x right, y up, z back without it."""

AXES = {0: RIGHT_UP_BACK, 1: LEFT_DOWN_BACK, 4: RIGHT_UP_BACK, 6: RIGHT_DOWN_FORWARD, 7: LEFT_UP_FORWARD}
"""Signs that convert from the axes of these kinds; 0 states none. The others are mirrored, or quarter turns."""

GZIP_LEVEL = 9
# Maximum bytes that reading takes per Gaussian and per spherical-harmonics coefficient, as measured.
READING = (320, 28)
ZSTD_OPTIONS: tuple[dict[int, int], ...] = (
    {zstd.CompressionParameter.compression_level: 19},
    {zstd.CompressionParameter.compression_level: 19, zstd.CompressionParameter.min_match: 5},
)
"""Settings to try for each stream; which is better depends on how often runs of three bytes repeat by chance."""


@dataclass(frozen=True)
class Stored:
    """The content of a file, decompressed.

    Attributes:
        layout: of the streams.
        streams: the six streams.
        flags: of the header.
        axes: signs that convert to ours.
    """

    layout: Layout
    streams: list[bytes]
    flags: int
    axes: tuple[int, int, int] = RIGHT_UP_BACK


def write_gaussians(path: Path, gaussians: Gaussians, version: Version = CURRENT, precision: Precision = FINE) -> None:
    """Write a scene atomically; warn if its sizes exceed the format's, or else if its centres are rounded coarsely.

    Raises:
        PocketGSError: the scene is empty, holds NaN or infinity or is too large, or the file cannot be written.
    """
    contents = encode(gaussians, version, precision, path)
    bits = fractional_bits_for(gaussians, precision)
    assert bits is not None
    if exceeds_range(gaussians):
        warn_of_range(path, gaussians)
    else:
        warn_if_coarse(path, gaussians, 2.0**-bits)
    with replacing(path) as partial:
        partial.write_bytes(contents)


def encode(
    gaussians: Gaussians,
    version: Version = CURRENT,
    precision: Precision = FINE,
    path: Path = Path("scene.spz"),
) -> bytes:
    """Encode a scene as the content of a file.

    Args:
        gaussians: the scene.
        version: of the format.
        precision: the rounding of the numbers.
        path: for error messages.

    Raises:
        PocketGSError: the scene is empty, holds NaN or infinity, or is too large.
    """
    require_sound(path, gaussians)
    bits = fractional_bits_for(gaussians, precision)
    if bits is None:
        raise PocketGSError(f"{path}: a coordinate exceeds {MAX_FIXED}, the maximum of .spz")
    layout = Layout(version, len(gaussians), gaussians.sh_degree, bits)
    streams = _packed(gaussians, layout, precision)
    return _bundle(layout, streams) if version == 4 else _gzip(layout, streams)


def is_visibly_cut(gaussians: Gaussians, precision: Precision) -> bool:
    """Whether a file cannot hold a scene, or only with other sizes or centres that show; all its numbers are finite."""
    bits = fractional_bits_for(gaussians, precision)
    return bits is None or exceeds_range(gaussians) or is_coarse(gaussians, 2.0**-bits)


def rounded(gaussians: Gaussians, precision: Precision) -> Gaussians:
    """A scene as a file holds it, without the time that packing the file takes; it is not `is_visibly_cut`."""
    bits = fractional_bits_for(gaussians, precision)
    assert bits is not None
    layout = Layout(CURRENT, len(gaussians), gaussians.sh_degree, bits)
    return half_turn(unpack(_packed(gaussians, layout, precision), layout), RIGHT_UP_BACK)


def _packed(gaussians: Gaussians, layout: Layout, precision: Precision) -> list[bytes]:
    """The six streams, not compressed."""
    turned = half_turn(gaussians, RIGHT_UP_BACK)
    return pack(rearranged(turned, precision) if precision.rearranged else turned, layout, precision)


def read_gaussians(path: Path) -> Gaussians:
    """Read a scene of any version. Coefficients of degree 4, which are dropped, and anti-aliasing are warnings.

    Raises:
        PocketGSError: the file is missing, broken, of an unknown version, or states axes that mirror the scene.
    """
    contents = read_contents(path)
    if contents.startswith(GZIP_MAGIC):
        stored = _gunzip(path, contents)
    elif contents.startswith(MAGIC):
        stored = _unbundle(path, contents)
    else:
        raise PocketGSError(f"{path}: not a .spz: begins with {contents[:4]!r}, expected {MAGIC!r} or {GZIP_MAGIC!r}")
    gaussians = half_turn(unpack(stored.streams, stored.layout), stored.axes)
    require_sound(path, gaussians)
    antialiased.warn_if(bool(stored.flags & ANTIALIASED), path)
    if stored.layout.sh_degree == MAX_DEGREE:
        warn_of_degree_4(path)
    return gaussians


def _header(layout: Layout, last: int) -> bytes:
    bits = layout.fractional_bits
    return HEADER.pack(MAGIC, layout.version, layout.count, layout.sh_degree, bits, 0, last)


def _layout(path: Path, header: bytes, versions: tuple[int, ...]) -> tuple[Layout, int, int]:
    """Parse a header into the layout, the flags and the last byte.

    Raises:
        PocketGSError: the header is cut short or of another version, its degree or count is out of range, or the scene
            exceeds the memory bound.
    """
    if len(header) < HEADER.size:
        raise PocketGSError(f"{path}: cut short: {len(header)} bytes of a header of {HEADER.size}")
    magic, version, count, degree, bits, flags, last = HEADER.unpack(header[: HEADER.size])
    if magic != MAGIC:
        raise PocketGSError(f"{path}: not a .spz: holds {magic!r}, expected {MAGIC!r}")
    if version not in versions:
        raise PocketGSError(f"{path}: version {version} in this container, expected {' or '.join(map(str, versions))}")
    if degree > MAX_DEGREE:
        raise PocketGSError(f"{path}: spherical harmonics of degree {degree}, expected 0 to {MAX_DEGREE}")
    require_any(path, count)
    require_room(path, count, (degree + 1) ** 2, READING)
    return Layout(version, count, degree, bits), flags, last


def _gzip(layout: Layout, streams: list[bytes]) -> bytes:
    compressor = zlib.compressobj(GZIP_LEVEL, wbits=WINDOW)
    parts = [compressor.compress(part) for part in (_header(layout, 0), *streams)]
    return b"".join([*parts, compressor.flush()])


def _gunzip(path: Path, contents: bytes) -> Stored:
    """Decompress at most as many bytes as the header states, however far the gzip file would expand."""
    members = GzipMembers(contents)
    try:
        header = members.take(HEADER.size)
        layout, flags, _ = _layout(path, header, (1, 2, 3))
        needed = sum(layout.sizes)
        body, more = members.take(needed), members.take(1)
    except zlib.error as error:
        raise PocketGSError(f"{path}: not a readable gzip stream ({error})") from error
    if len(body) < needed:
        raise PocketGSError(f"{path}: cut short: {len(body)} bytes of the {needed} for {layout.count} Gaussians")
    # Extensions come after the streams; none of them changes how the streams are read.
    if more and not flags & HAS_EXTENSIONS:
        raise PocketGSError(f"{path}: holds more than the {needed} bytes for {layout.count} Gaussians")
    return Stored(layout, _cut(body, layout), flags)


def _cut(body: bytes, layout: Layout) -> list[bytes]:
    streams, start = [], 0
    for size in layout.sizes:
        streams.append(body[start : start + size])
        start += size
    return streams


def _bundle(layout: Layout, streams: list[bytes]) -> bytes:
    streams = [stream for stream in streams if stream]
    packed = [min((zstd.compress(stream, options=options) for options in ZSTD_OPTIONS), key=len) for stream in streams]
    table = [TABLE_ROW.pack(len(small), len(whole)) for small, whole in zip(packed, streams, strict=True)]
    return b"".join([_header(layout, len(streams)), TABLE_START.pack(FIRST_ROW), *table, *packed])


def _unbundle(path: Path, contents: bytes) -> Stored:
    layout, flags, count = _layout(path, contents, (4,))
    expected = [size for size in layout.sizes if size]
    if count < len(expected) or count > STREAMS:
        raise PocketGSError(f"{path}: {count} streams, expected {len(expected)} for degree {layout.sh_degree}")
    try:
        (table,) = TABLE_START.unpack_from(contents, HEADER.size)
        rows = [TABLE_ROW.unpack_from(contents, table + index * TABLE_ROW.size) for index in range(count)]
    except struct.error as error:
        raise PocketGSError(f"{path}: cut short: {len(contents)} bytes, in the table of streams ({error})") from error
    axes = _axes(path, contents[FIRST_ROW:table]) if flags & HAS_EXTENSIONS else RIGHT_UP_BACK
    streams, start = [], table + count * TABLE_ROW.size
    for index, ((small, whole), size) in enumerate(zip(rows, layout.sizes, strict=False)):
        if whole != size:
            raise PocketGSError(f"{path}: stream {index} has {whole} bytes, expected {size}")
        streams.append(_decompress(path, contents[start : start + small], small, size))
        start += small
    return Stored(layout, streams + [b""] * (STREAMS - len(streams)), flags, axes)


def _decompress(path: Path, packed: bytes, stated: int, size: int) -> bytes:
    if len(packed) < stated:
        raise PocketGSError(f"{path}: cut short: {len(packed)} bytes of a stream of {stated}")
    if not size:
        return b""
    decompressor = zstd.ZstdDecompressor()
    try:
        # One byte more than expected, to detect excess data.
        stream = decompressor.decompress(packed, max_length=size + 1)
    except zstd.ZstdError as error:
        raise PocketGSError(f"{path}: not a readable Zstandard stream ({error})") from error
    if len(stream) != size:
        raise PocketGSError(f"{path}: a stream unpacks to {len(stream)} bytes or more, expected {size}")
    return bytes(stream)


def _axes(path: Path, records: bytes) -> tuple[int, int, int]:
    """Signs that convert from the axes that extensions state; unknown extensions are skipped.

    Raises:
        PocketGSError: the records are cut short, or state axes that are no half turn from ours.
    """
    axes = RIGHT_UP_BACK
    while records:
        if len(records) < EXTENSION.size:
            raise PocketGSError(f"{path}: an extension is cut short after {len(records)} bytes")
        kind, size = EXTENSION.unpack_from(records)
        payload, records = records[EXTENSION.size : EXTENSION.size + size], records[EXTENSION.size + size :]
        if kind != AXES_EXTENSION:
            continue
        stated = int.from_bytes(payload[:4], "little")
        if len(payload) < 4 or stated not in AXES:
            expected = f"one of {', '.join(map(str, AXES))}: save it with axes right, up, back, which is 4"
            raise PocketGSError(f"{path}: axes of kind {payload[:4].hex()}, expected {expected}")
        axes = AXES[stated]
    return axes
