"""Scene files to download: `.ply` as it was trained, and smaller formats, written when they are first asked for."""

from __future__ import annotations

import asyncio
import os
from pathlib import Path
from urllib.parse import quote

from pocketgs.results.folder import COMPRESSED, SCENE
from pocketgs.scene.formats import read_scene, write_scene
from pocketgs.serve.shelf import RESULT

FOLDER = "downloads"
SUFFIXES = (".ply", ".spz", ".pgs")


class Downloads:
    """Scenes in the formats to download. They are converted one at a time, each in a thread of its own."""

    def __init__(self) -> None:
        # Requests that wait hold no thread: all that the server does shares a few.
        self._one_at_a_time = asyncio.Lock()

    async def scene_file(self, place: Path, suffix: str) -> Path:
        """A capture's scene in a format; converting takes a second or so.

        Args:
            place: the capture's folder.
            suffix: one of `SUFFIXES`.

        Raises:
            PocketGSError: it cannot be converted.
            OSError: there is no scene.
        """
        scene, compressed = place / RESULT / SCENE, place / RESULT / COMPRESSED
        trained = scene.stat().st_mtime_ns
        if suffix == ".ply":
            return scene
        if suffix == ".pgs" and compressed.is_file():
            return compressed
        path = place / FOLDER / f"scene{suffix}"
        async with self._one_at_a_time:
            if not path.is_file() or path.stat().st_mtime_ns != trained:
                await asyncio.to_thread(_convert, scene, path, trained)
        return path


def _convert(scene: Path, path: Path, trained: int) -> None:
    """Convert a scene that was trained at a time, in nanoseconds."""
    path.parent.mkdir(exist_ok=True)
    write_scene(path, read_scene(scene))
    # A later scene may have been written earlier than this file: before it was evaluated and put in place.
    os.utime(path, ns=(trained, trained))


def disposition(title: str, suffix: str) -> str:
    """The header that names a download after the capture's title, whatever is in that (RFC 6266)."""
    return f"attachment; filename*=UTF-8''{quote(title, safe='')}{suffix}"
