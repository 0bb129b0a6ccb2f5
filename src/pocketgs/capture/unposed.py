"""Photographs or a video without poses, of which structure from motion makes a capture."""

from __future__ import annotations

from pathlib import Path

from pocketgs.capture.paths import list_images
from pocketgs.capture.video_file import VIDEO_SUFFIXES

# Those image files that COLMAP reads too.
PHOTOGRAPH_SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp"})
NESTED_FOLDER = "images"


def is_video(path: Path) -> bool:
    """Whether the path is a file with a video's suffix."""
    return path.suffix.lower() in VIDEO_SUFFIXES and path.is_file()


def find_photographs(folder: Path) -> list[Path]:
    """The photographs directly in a folder, or where it has none those in its folder `images`, sorted by name."""
    for candidate in (folder, folder / NESTED_FOLDER):
        if candidate.is_dir():
            found = [path for path in list_images(candidate) if path.suffix.lower() in PHOTOGRAPH_SUFFIXES]
            if found:
                return found
    return []


def holds_photographs(path: Path) -> bool:
    """Whether the path is a video, or a folder with photographs."""
    return is_video(path) or bool(find_photographs(path))
