"""What lies where a capture was expected, for messages that say what to do."""

from __future__ import annotations

from pathlib import Path

from pocketgs.capture.unposed import photographs_by_folder, videos_in
from pocketgs.errors import counted, listed
from pocketgs.files.paths import UNREAD_SUFFIXES, relative_name

ARCHIVE_SUFFIXES = frozenset({".zip", ".7z", ".rar", ".tar", ".gz", ".tgz", ".bz2", ".xz"})
PROGRAMS = {
    ".sfm": "Meshroom",
    ".mg": "Meshroom",
    ".psx": "Metashape",
    ".psz": "Metashape",
    ".rcproj": "RealityCapture",
    ".rsproj": "RealityScan",
    ".nvm": "VisualSFM",
}
"""Programs that find poses, by the suffix of their project files, which are not read."""

MAX_NAMES = 4


def what_is_there(path: Path) -> str:
    """What a path holds instead of a capture, and what to do; empty if there is nothing to say.

    Raises:
        OSError: a folder cannot be read.
    """
    if not path.is_dir():
        return "it is an archive: unpack it first" if _is_archive(path) else _project_of(path)
    by_folder, videos = photographs_by_folder(path), videos_in(path)
    if len(by_folder) > 1:
        sizes = [f"{relative_name(folder, path)} ({len(found)})" for folder, found in by_folder.items()]
        return f"it holds photographs in several folders, {listed(sizes, MAX_NAMES)}: move them to one, or name one"
    if len(videos) > 1:
        return f"it holds several videos, {listed([video.name for video in videos], MAX_NAMES)}: name one"
    archives = [file.name for file in sorted(path.iterdir()) if _is_archive(file)]
    if archives:
        return f"it holds {listed(archives, MAX_NAMES)}: unpack archives first"
    projects = map(_project_of, sorted(path.iterdir()))
    return next(filter(None, projects), "") or unread_pictures(path)


def _project_of(file: Path) -> str:
    """What to do with a project file of another program; empty if it is none."""
    program = PROGRAMS.get(file.suffix.lower())
    if program is None:
        return ""
    return (
        f"{file.name} is a project of {program}: export its cameras for COLMAP or as transforms.json, or name the "
        "folder of its photographs, for which poses are computed"
    )


def unread_pictures(folder: Path) -> str:
    """The number and suffixes of the pictures directly in a folder that are not read; empty if there are none."""
    suffixes = [file.suffix.lower() for file in folder.iterdir() if not file.name.startswith(".")]
    unread = [suffix for suffix in suffixes if suffix in UNREAD_SUFFIXES]
    if not unread:
        return ""
    found = counted(len(unread), "other picture is not read", "other pictures are not read")
    return f"{found} ({', '.join(sorted(set(unread)))})"


def _is_archive(path: Path) -> bool:
    return path.suffix.lower() in ARCHIVE_SUFFIXES and not path.name.startswith(".") and path.is_file()
