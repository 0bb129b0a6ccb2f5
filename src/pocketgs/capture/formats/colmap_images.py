"""The image files of a COLMAP model's registered images."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path, PureWindowsPath

from pocketgs.capture.last_numbers import pair_by_number
from pocketgs.capture.named_images import find_images, find_stated, images_below, spelling
from pocketgs.capture.unposed import USUAL_FOLDER, few_posed
from pocketgs.capture.unrecognised import MAX_NAMES
from pocketgs.errors import PocketGSError, listed
from pocketgs.files.paths import list_images, relative_name

Files = tuple[list[Path | None], tuple[str, ...]]
"""Each registered image's file, None where it is missing, and warnings."""


def match_files(
    names: Sequence[str], folder: Path, capture: Path, where: str, leave_out: Callable[[Path], bool] | None
) -> Files:
    """Find the file of each registered image.

    Args:
        names: of the registered images.
        folder: of the images.
        capture: the capture's folder.
        where: the file that states the names, for messages.
        leave_out: if images are searched in the whole capture where `folder` holds none: whether the search leaves out
            a folder; None to search nowhere else.

    Raises:
        PocketGSError: a name is not usable, or no image is found.
    """
    files, warnings = _named(names, folder, capture, where, leave_out)
    absent = [name for name, file in zip(names, files, strict=True) if file is None]
    if len(absent) == len(names):
        return _renamed(names, folder, capture)
    if absent:
        warnings += (f"{len(absent)} of {len(names)} registered images are absent, the first {absent[0]}",)
    return files, warnings + few_posed(files, (), capture, "the COLMAP model")


def holds_any(folder: Path, names: Sequence[str], where: str) -> bool:
    """Whether a folder holds a registered image. Of absolute paths, which are another machine's, only names count."""
    bare = [PureWindowsPath(name).name if PureWindowsPath(name).root else name for name in names]
    return any(find_stated(folder, bare, where))


def _named(
    names: Sequence[str], folder: Path, capture: Path, where: str, leave_out: Callable[[Path], bool] | None
) -> Files:
    # Absolute paths are of the machine that wrote them: those images are found by name alone.
    were_elsewhere = leave_out is not None and any(PureWindowsPath(name).root for name in names)
    files: list[Path | None] = [] if were_elsewhere else find_stated(folder, names, where)
    if any(files) or leave_out is None:
        return files, ()
    # As with relative names, those of the folder beside the model come first: the originals have the same names.
    below = [f"{USUAL_FOLDER}/{name}" for name in names]
    warnings: tuple[str, ...] = ()
    for place in dict.fromkeys((folder, capture) if were_elsewhere else (capture,)):
        files, warnings = find_images(place, below, where, leave_out=leave_out)
        if any(files):
            break
    return files, warnings


def _renamed(names: Sequence[str], folder: Path, capture: Path) -> Files:
    """The files of images whose downscaled copies were renamed (LLFF: images/IMG_4026.JPG, images_8/image000.png).

    Raises:
        PocketGSError: there are not as many files as names.
    """
    present = list_images(folder)
    if len(present) != len(names):
        found = f"{folder}: holds none of the {len(names)} registered images, such as {names[0]}"
        raise PocketGSError(f"{found}{_where_they_may_be(names, capture)}")
    by_number = pair_by_number(names, present)
    by_name = by_number or dict(zip(sorted(names), present, strict=True))
    how = "by the numbers in their names" if by_number else "in sorted order"
    message = f"{relative_name(folder, capture)} names its files otherwise: matched to the model {how}"
    return [by_name[name] for name in names], (message,)


def _where_they_may_be(names: Sequence[str], capture: Path) -> str:
    """The folders of a capture that may hold the images, for a message; empty if there are none.

    They hold images of these names, several folders the same ones, or as many with the same numbers in their names.
    """
    wanted = {spelling(PureWindowsPath(name).name) for name in names}
    by_folder: dict[Path, list[Path]] = {}
    for file in images_below(capture, leave_out=lambda folder: False):
        by_folder.setdefault(file.parent, []).append(file)
    fitting = [
        relative_name(folder, capture)
        for folder, files in by_folder.items()
        if any(spelling(file.name) in wanted for file in files)
        or (len(files) == len(names) and pair_by_number(names, files))
    ]
    if not fitting:
        return ""
    return f"; those in {listed(fitting, MAX_NAMES)} may be meant: name the folder by --images"
