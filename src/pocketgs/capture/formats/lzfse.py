"""Decompression of LZFSE, Apple's format, with the optional extra `pocketgs[record3d]`."""

from __future__ import annotations

import importlib
import importlib.util
import struct

from pocketgs.errors import PocketGSError, clipped
from pocketgs.files.memory_bound import require_memory
from pocketgs.files.opening import read_bytes
from pocketgs.files.paths import CaptureFile

MODULE, PACKAGE = "liblzfse", "pyliblzfse"


def lzfse_is_installed() -> bool:
    """Whether the package that decompresses LZFSE is installed."""
    return importlib.util.find_spec(MODULE) is not None


def read_compressed(path: CaptureFile) -> bytes:
    """Read a file that is compressed with LZFSE.

    Raises:
        PocketGSError: the package is missing, the file is damaged, or its content exceeds the memory bound.
    """
    if not lzfse_is_installed():
        raise PocketGSError(f"{path}: compressed with LZFSE, which needs the package {PACKAGE}")
    try:
        content = read_bytes(path)
        unpacked = unpacked_size(content)
    except PocketGSError:
        raise
    except Exception as error:  # damaged files raise different types
        raise PocketGSError(f"{path}: cannot be decompressed with LZFSE ({clipped(error)})") from error
    require_memory(path, len(content) + 2 * unpacked, f"unpacking {unpacked:,} bytes")
    try:
        return bytes(importlib.import_module(MODULE).decompress(content))
    except Exception as error:
        raise PocketGSError(f"{path}: cannot be decompressed with LZFSE ({clipped(error)})") from error


def unpacked_size(content: bytes) -> int:
    """Size of the decompressed content, as the LZFSE blocks state it.

    A block starts with its type and its decompressed size; where its compressed size is depends on the type (Apple's
    reference implementation, lzfse_internal.h).

    Raises:
        ValueError: the block type is unknown.
        struct.error: the content ends within a header.
    """
    total, at = 0, 0
    while (kind := content[at : at + 4]) != b"bvx$":
        (unpacked,) = struct.unpack_from("<I", content, at + 4)
        total += unpacked
        if kind == b"bvx-":  # stored
            at += 8 + unpacked
        elif kind == b"bvxn":  # LZVN
            at += 12 + struct.unpack_from("<I", content, at + 8)[0]
        elif kind == b"bvx2":  # LZFSE; literal, match and header lengths are packed into bits
            literals, matches, header = struct.unpack_from("<QQQ", content, at + 8)
            at += (header & 0xFFFFFFFF) + (literals >> 20 & 0xFFFFF) + (matches >> 40 & 0xFFFFF)
        else:
            raise ValueError(f"a block of the unknown type {kind!r}")
    return total
