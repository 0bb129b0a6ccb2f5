"""Unpacking gzip files of one or more members, no further than asked for."""

from __future__ import annotations

import zlib

MAGIC = b"\x1f\x8b"
WINDOW = 16 + zlib.MAX_WBITS

PORTION = 1 << 16
"""Bytes to unpack from at once: what follows a member is copied each time."""


class GzipMembers:
    """The content of a gzip file's members, one after the other; what follows them is ignored."""

    def __init__(self, packed: bytes) -> None:
        self._packed = packed
        self._place = 0
        self._decompressor = zlib.decompressobj(WINDOW)

    def take(self, size: int) -> bytes:
        """The next bytes; fewer at the end, or where the file is cut short.

        Raises:
            zlib.error: the file is not gzip.
        """
        parts: list[bytes] = []
        while size and self._is_within_member():
            portion = self._packed[self._place : self._place + PORTION]
            part = self._decompressor.decompress(portion, size)
            stream = self._decompressor
            left = len(stream.unused_data if stream.eof else stream.unconsumed_tail)
            if not part and left == len(portion):
                break
            self._place += len(portion) - left
            parts.append(part)
            size -= len(part)
        return b"".join(parts)

    def _is_within_member(self) -> bool:
        """Whether a member goes on, or another one begins, which it then is."""
        if self._decompressor.eof:
            if not self._packed.startswith(MAGIC, self._place):
                return False
            self._decompressor = zlib.decompressobj(WINDOW)
        return True
