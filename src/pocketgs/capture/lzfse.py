"""LZFSE, Apple's compression, through the optional extra `pocketgs[record3d]`."""

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
    """Whether compressed files can be read."""
    return importlib.util.find_spec(MODULE) is not None


def read_compressed(path: CaptureFile) -> bytes:
    """The content of a file that is compressed with LZFSE.

    Raises:
        PocketGSError: the package is missing, the file is damaged, or unpacked it needs more memory than there may be.
    """
    if not lzfse_is_installed():
        raise PocketGSError(f"{path}: compressed with LZFSE, which needs the package {PACKAGE}")
    try:
        content = read_bytes(path)
        unpacked = unpacked_size(content)
    except PocketGSError:
        raise
    except Exception as error:  # damaged archives and damaged headers raise whatever they trip over
        raise PocketGSError(f"{path}: cannot be decompressed with LZFSE ({clipped(error)})") from error
    require_memory(path, len(content) + 2 * unpacked, f"unpacking {unpacked:,} bytes")
    try:
        return bytes(importlib.import_module(MODULE).decompress(content))
    except Exception as error:
        raise PocketGSError(f"{path}: cannot be decompressed with LZFSE ({clipped(error)})") from error


def unpacked_size(content: bytes) -> int:
    """Bytes that LZFSE will unpack to, as its blocks state.

    A block begins with its kind and the number of bytes that it unpacks to; how long it is itself follows in a way that
    depends on the kind (Apple's reference implementation, lzfse_internal.h).

    Raises:
        ValueError: there is no such kind of block.
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
        elif kind == b"bvx2":  # LZFSE, with the lengths of literals, of matches, and of the header among other bits
            literals, matches, header = struct.unpack_from("<QQQ", content, at + 8)
            at += (header & 0xFFFFFFFF) + (literals >> 20 & 0xFFFFF) + (matches >> 40 & 0xFFFFF)
        else:
            raise ValueError(f"a block of the kind {kind!r}")
    return total
