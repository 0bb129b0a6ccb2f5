"""Zip files in memory."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping

_IS_UTF8 = 1 << 11

FROM_HERE = {"./": b"", "./toys/": b"", "./toys/transforms.json": b"{}", "././toys/images/a.png": b"a", "./b": b"b"}
MEANT = {"toys/transforms.json": b"{}", "toys/images/a.png": b"a", "b": b"b"}
"""Names that begin with the folder that was packed, and what they mean."""

NAMES = [
    ("Küche 台所.jpg".encode(), True, "Küche 台所.jpg"),
    ("Küche 台所.jpg".encode(), False, "Küche 台所.jpg"),
    ("\ufeffa.jpg".encode(), True, "\ufeffa.jpg"),
    *((bytes(range(i, i + 32)), False, bytes(range(i, i + 32)).decode("cp437")) for i in range(128, 256, 32)),
]
"""Names as written, whether the flag of UTF-8 is set, and the names that are meant."""


def zip_of(files: Mapping[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", method) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return content.getvalue()


def zip_of_name(written: bytes, is_utf8: bool) -> bytes:
    """An archive of one file, `x`, whose name is written in these bytes."""
    name = b"n" * len(written)
    content = bytearray(zip_of({name.decode(): b"x"}).replace(name, written))
    for mark, flags in ((b"PK\x03\x04", 7), (b"PK\x01\x02", 9)):
        content[content.index(mark) + flags] |= (_IS_UTF8 >> 8) * is_utf8
    return bytes(content)
