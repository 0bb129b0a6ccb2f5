"""Telling from a file's beginning whether it is a scene."""

from __future__ import annotations

from pathlib import Path

from pocketgs.files.ply_header import header_in
from pocketgs.scene.formats.compressed_ply import PACKED
from pocketgs.scene.formats.gltf import EXTENSION
from pocketgs.scene.formats.gltf_document import GLB_MAGIC
from pocketgs.scene.formats.gzip_members import MAGIC as GZIP_MAGIC
from pocketgs.scene.formats.pgs_sections import MAGIC as PGS_MAGIC
from pocketgs.scene.formats.splat import RECORD
from pocketgs.scene.formats.spz import MAGIC as SPZ_MAGIC

BEGINNING = 100_000
"""Bytes that hold a header."""

ZIP_MAGIC = b"PK"


def is_scene(path: Path) -> bool:
    """Whether a file looks like a scene in the format that its name states; `.ply` and `.glb` hold other things too.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        beginning = file.read(BEGINNING)
    match path.suffix.lower():
        case ".ply":
            header = header_in(beginning) or beginning
            return header.startswith(b"ply") and any(name in header for name in (b" f_dc_0", PACKED[0].encode()))
        case ".glb":
            return beginning.startswith(GLB_MAGIC) and EXTENSION.encode() in beginning
        case ".spz":
            return beginning.startswith((SPZ_MAGIC, GZIP_MAGIC))
        case ".pgs":
            return beginning.startswith(PGS_MAGIC)
        case ".sog":
            return beginning.startswith(ZIP_MAGIC)
        case ".splat":  # without any magic
            return path.stat().st_size % RECORD.itemsize == 0
    return False
