"""Decompression of LZFSE, Apple's format."""

from __future__ import annotations

import struct

import lzfse

from pocketgs.errors import PocketGSError, clipped
from pocketgs.files.memory_bound import require_memory
from pocketgs.files.opening import CaptureFile, read_bytes

MAX_MATCH = 2359
"""Most bytes that one match of an LZFSE block copies: the largest of its 20 length symbols, 312, and 11 bits beyond."""

MAX_LITERALS = 40_064
"""Most literals that an LZFSE block copies: the decoder's buffer ends there."""

MIN_HEADER = 32
"""Bytes of the shortest header of an LZFSE block."""

MAX_LZVN_GROWTH = 136
"""Most bytes per byte of an LZVN block: two bytes copy up to 271."""


def read_compressed(path: CaptureFile) -> bytes:
    """Read a file that is compressed with LZFSE.

    Raises:
        PocketGSError: the file is damaged, or its content could exceed the memory bound.
    """
    content = read_bytes(path)
    try:
        most = most_unpacked(content)
    except (ValueError, struct.error) as error:
        raise PocketGSError(f"{path}: cannot be decompressed with LZFSE ({clipped(error)})") from error
    # While it unpacks, the library's buffer grows to up to twice the size of the content, which is then copied.
    require_memory(path, len(content) + 3 * most, f"unpacking up to {most:,} bytes")
    try:
        return bytes(lzfse.decompress(content))
    except Exception as error:  # the library raises several types
        raise PocketGSError(f"{path}: cannot be decompressed with LZFSE ({clipped(error)})") from error


def most_unpacked(content: bytes) -> int:
    """Upper bound of the decompressed size.

    A block starts with its type and its decompressed size, but nothing holds a damaged file to that size. So the bound
    follows from how much the block's literals and matches can make. Where a block ends depends on its type (Apple's
    reference implementation, lzfse_internal.h).

    Raises:
        ValueError: the block type is unknown.
        struct.error: the content ends within a header.
    """
    total, at = 0, 0
    while (kind := content[at : at + 4]) != b"bvx$":
        if kind == b"bvx-":  # stored
            (stored,) = struct.unpack_from("<I", content, at + 4)
            total += min(stored, len(content))
            at += 8 + stored
        elif kind == b"bvxn":  # LZVN
            (packed,) = struct.unpack_from("<I", content, at + 8)
            total += MAX_LZVN_GROWTH * min(packed, len(content))
            at += 12 + packed
        elif kind == b"bvx2":  # LZFSE; the number of matches and the lengths of the parts are packed into bits
            first, second, third = struct.unpack_from("<QQQ", content, at + 8)
            header, literals, matches = third & 0xFFFFFFFF, first >> 20 & 0xFFFFF, second >> 40 & 0xFFFFF
            if header < MIN_HEADER:
                raise ValueError(f"a header of {header} bytes")
            total += MAX_LITERALS + MAX_MATCH * (first >> 40 & 0xFFFFF)
            at += header + literals + matches
        else:
            raise ValueError(f"a block of the unknown type {kind!r}")
    return total
