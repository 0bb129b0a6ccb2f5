"""Which files of scenes are marked as trained with anti-aliasing."""

from __future__ import annotations

from pathlib import Path

from pocketgs.files.ply_file import read_comments
from pocketgs.scene.formats.antialiased import is_marked


def is_antialiased(path: Path) -> bool:
    """Whether a `.ply` or `.sog` is marked; other formats either hold no mark or are read as they are.

    Raises:
        PocketGSError: the file is missing or broken.
    """
    match path.suffix.lower():
        case ".ply":
            return is_marked(read_comments(path))
        case ".sog":
            # Imported here because Pillow is slow to load.
            from pocketgs.scene.formats import sog

            return sog.is_antialiased(path)
    return False
