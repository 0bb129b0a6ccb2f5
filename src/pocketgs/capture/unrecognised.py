"""What lies where a capture was expected, for messages that say what to do."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

from pocketgs.capture.unposed import find_photographs, find_photographs_in, photographs_by_folder, videos_in
from pocketgs.errors import counted, listed
from pocketgs.files.paths import UNREAD_SUFFIXES, is_folder_of_photographs, relative_name

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

MAX_ENTRIES = 5000
"""Files and folders to look at, at most, for what lies deep in a folder: users may name their whole disk."""


def what_is_there(path: Path, is_capture: Callable[[Path], bool] = lambda folder: False) -> str:
    """What a path holds instead of a capture, and what to do; empty if there is nothing to say.

    Args:
        path: a file or folder.
        is_capture: whether a folder is one, for those that lie deep in it.

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
    return next(filter(None, projects), "") or _what_lies_deep(path, is_capture) or unread_pictures(path)


def _what_lies_deep(path: Path, is_capture: Callable[[Path], bool]) -> str:
    """The captures below a folder, or else the folders below it with more photographs than are found for it."""
    captures, photographs = list[Path](), dict[str, int]()
    fewest = len(find_photographs(path)) + 1
    for folder in _folders_below(path):
        if any(capture in folder.parents for capture in captures):
            continue  # a part of it
        if is_capture(folder):
            captures.append(folder)
        elif (count := len(find_photographs_in(folder))) >= fewest:
            photographs[relative_name(folder, path)] = count
    if captures:
        names = [relative_name(folder, path) for folder in captures]
        several = f"captures are in {listed(names, MAX_NAMES)}: name one of them"
        return several if len(names) > 1 else f"a capture is in {names[0]}: name that folder"
    if len(photographs) == 1:
        [(name, count)] = photographs.items()
        return f"photographs are in {name}, {count} of them: name that folder"
    sizes = [f"{name} ({count})" for name, count in sorted(photographs.items(), key=lambda item: -item[1])]
    return f"photographs are in several folders, {listed(sizes, MAX_NAMES)}: name one of them" if sizes else ""


def _folders_below(path: Path) -> Iterator[Path]:
    """The folders below a folder, the less deep first, as far as `MAX_ENTRIES` entries reach.

    Links, folders that cannot be read, and folders of masks, depths and the like are left out.
    """
    waiting, left = deque([path]), MAX_ENTRIES
    while waiting and left > 0:
        folder = waiting.popleft()
        try:
            with os.scandir(folder) as found:
                entries = list(islice(found, left))
        except OSError:
            continue
        left -= len(entries) + 1
        inner = (folder / entry.name for entry in entries if entry.is_dir(follow_symlinks=False))
        waiting += sorted(filter(is_folder_of_photographs, inner))
        if folder != path:
            yield folder


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
