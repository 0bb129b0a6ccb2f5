"""The container of a `.pgs`: named, typed sections behind a checksum.

    header      magic "PGSC", version (u16), number of sections (u16), CRC-32 of all that follows (u32)
    table       per section: name (8 bytes, padded with zeros), type (u8), flags (u8), 0 (u16), size (u32)
    sections    one after the other

A reader refuses a section that it does not know, unless the flag `OPTIONAL` allows it to skip it.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from pocketgs.errors import PocketGSError
from pocketgs.files.opening import open_file

MAGIC, VERSION = b"PGSC", 1
HEADER = struct.Struct("<4sHHI")
ROW = struct.Struct("<8sBBHI")
MAX_SECTIONS = 0xFFFF

FIELDS, TREE, COLUMNS = 1, 2, 3
"""Types: fields of fixed sizes, a tree of positions, and range-coded columns."""

OPTIONAL = 1
"""Flag of a section that readers may skip."""

WEIGHTS = "weights"
"""The section that a scene has if it is drawn without sorting."""


@dataclass(frozen=True)
class Section:
    """A part of a file.

    Attributes:
        name: at most 8 ASCII characters.
        kind: its type.
        content: its bytes.
        flags: `OPTIONAL` or 0.
    """

    name: str
    kind: int
    content: bytes
    flags: int = 0


def join_sections(sections: list[Section]) -> bytes:
    """The content of a file."""
    table = [ROW.pack(each.name.encode("ascii"), each.kind, each.flags, 0, len(each.content)) for each in sections]
    body = b"".join([*table, *(each.content for each in sections)])
    return HEADER.pack(MAGIC, VERSION, len(sections), zlib.crc32(body)) + body


def section_names(path: Path) -> set[str]:
    """Names of a file's sections, from its first bytes alone; none if it is no `.pgs` or cannot be read.

    Raises:
        PocketGSError: it lies outside the folder that is being read.
    """
    try:
        if not path.is_file():
            return set()
        with open_file(path) as file:
            return names_in(file.read(HEADER.size + MAX_SECTIONS * ROW.size))
    except OSError:
        return set()


def names_in(contents: bytes) -> set[str]:
    """Names of the sections in the first bytes of a file; none if it is no `.pgs`."""
    if len(contents) < HEADER.size or contents[:4] != MAGIC:
        return set()
    table = contents[HEADER.size :][: HEADER.unpack_from(contents)[2] * ROW.size]
    return {text_of(row[0]) for row in ROW.iter_unpack(table[: len(table) // ROW.size * ROW.size])}


def split_sections(path: Path, contents: bytes, known: Collection[tuple[str, int]]) -> dict[str, bytes]:
    """The contents of the known sections, by name.

    Args:
        path: the file, for messages.
        contents: its bytes.
        known: names and types of sections that the reader understands.

    Raises:
        PocketGSError: the file is cut short, damaged or of another version, or holds an unknown or repeated section.
    """
    if len(contents) < HEADER.size or contents[:4] != MAGIC:
        raise PocketGSError(f"{path}: not a .pgs: begins with {contents[:4]!r}, expected {MAGIC!r}")
    _, version, count, checksum = HEADER.unpack_from(contents)
    if version != VERSION:
        raise PocketGSError(f"{path}: a .pgs of version {version}, expected {VERSION}: a newer PocketGS may read it")
    start = HEADER.size + count * ROW.size
    rows = list(ROW.iter_unpack(contents[HEADER.size : start])) if start <= len(contents) else []
    expected = start + sum(row[-1] for row in rows)
    if len(contents) != expected:
        raise PocketGSError(f"{path}: not a whole .pgs: {len(contents):,} bytes, expected {expected:,}")
    if zlib.crc32(contents[HEADER.size :]) != checksum:
        raise PocketGSError(f"{path}: a damaged .pgs: its checksum differs from that of its content")
    found: dict[str, bytes] = {}
    for name, kind, flags, _, size in rows:
        text = text_of(name)
        if (text, kind) in known and text not in found:
            found[text] = contents[start : start + size]
        elif not flags & OPTIONAL:
            raise PocketGSError(f"{path}: section {text!r} of type {kind} is repeated or unknown to this version")
        start += size
    return found


def text_of(name: bytes) -> str:
    """A name that is padded with zeros."""
    return name.rstrip(b"\0").decode("ascii", "backslashreplace")
