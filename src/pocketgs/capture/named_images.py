"""Finding the image files that a capture names, also when they have moved."""

from __future__ import annotations

import os
import re
import unicodedata
from collections import defaultdict
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path, PureWindowsPath

from pocketgs.errors import PocketGSError
from pocketgs.files.opening import folders_around
from pocketgs.files.paths import existing_file, inside, is_folder_of_photographs, is_image, list_images, relative_name

DEEPEST = 4
"""Maximum depth of nested folders to search."""

ANY_SUFFIX = "/*"
"""Key for a name with any suffix; no file name ends like this."""


def find_images(
    folder: Path,
    named: Sequence[str],
    where: str,
    suffixes: tuple[str, ...] = ("",),
    leave_out: Callable[[Path], bool] = lambda folder: False,
) -> tuple[list[Path | None], tuple[str, ...]]:
    """Find the file of each image that a capture names; returns warnings too.

    If no stated path exists (see `find_stated`), each image is searched by name in the whole capture, or else by its
    name with another suffix: captures get moved, images get converted, and many tools write paths of the machine that
    they ran on. Others write paths from the folder that they ran in: if the capture has no such image, the stated paths
    are tried from the folders around it that are being read. If some stated paths exist, the others are missing.

    Args:
        folder: the capture's; files must lie in it, or in a folder around it that is being read.
        named: stated paths, relative to it.
        where: the file that states them, for messages.
        suffixes: to try at the end of each.
        leave_out: whether the search by name leaves out a folder.

    Returns:
        Files, None where missing, and warnings.

    Raises:
        PocketGSError: a path is not usable, or leaves the folder; paths that all are of another machine are fine if a
            file inside has the name of one of them.
    """
    refusal: PocketGSError | None = None
    try:
        files = find_stated(folder, [_relative(name, folder) or name for name in named], where, suffixes)
    except PocketGSError as error:
        files, refusal = [], error
    if any(files):
        return files, ()
    files = _by_name_alone(images_below(folder, leave_out), named, suffixes)
    if not any(files):
        files, warnings = _stated_from_around(folder, named, where, suffixes)
        if any(files):
            return files, warnings
    found = [(name, file) for name, file in zip(named, files, strict=True) if file is not None]
    moved = found and all(PureWindowsPath(name).root for name in named)
    if refusal and not moved and len(found) < len(named):
        raise refusal
    if not found:
        return files, ()
    name, file = found[0]
    said = f"no image is at its stated path; {len(found)} of {len(named)} were found by their names"
    return files, (f"{where}: {said}, such as {relative_name(file, folder)} for {name}",)


def _stated_from_around(
    folder: Path, named: Sequence[str], where: str, suffixes: tuple[str, ...]
) -> tuple[list[Path | None], tuple[str, ...]]:
    """The files at stated paths from the closest folder around the capture's that has one; and a warning."""
    for place in folders_around(folder)[1:]:
        with suppress(PocketGSError):  # absolute paths, and such that lead out
            files = find_stated(place, named, where, suffixes)
            if any(files):
                return files, (f"{where}: its paths are from the folder {place}, and not from its own",)
    return [None] * len(named), ()


def find_stated(folder: Path, named: Sequence[str], where: str, suffixes: tuple[str, ...] = ("",)) -> list[Path | None]:
    """The files that `find_images` finds in the stated folders.

    Case, the separator of folders, and the encoding of accents may differ. So may the suffix, if no other file has the
    same stem, and no image of that folder exists under the suffix: whoever converts images converts them all.

    Raises:
        PocketGSError: a path is not usable, or leaves the folder.
    """
    spelt_in = cache(_spelt_in)
    files = [existing_file(folder, name, where, suffixes) for name in named]
    if all(files):
        return files
    present = {
        index: spelt_in(inside(folder, with_slashes(name), where).parent)
        for index, name in enumerate(named)
        if files[index] is None
    }
    for index, beside in present.items():
        files[index] = _only(_of_the_name(beside, named[index], suffixes))
    taken, unconverted = set(files), _kinds(named, files)
    for index, beside in present.items():
        if files[index] is None and _kind(named[index]) not in unconverted:
            files[index] = _only([file for file in _of_the_stem(beside, named[index]) if file not in taken])
    return files


def find_moved(folder: Path, stated: str, where: str, photograph: Path | None = None) -> Path | None:
    """The file that a capture names: for an absolute path outside it, by the longest end of it that exists.

    Absolute paths are of the machine that wrote them.

    Args:
        folder: the capture's; the file must lie in it, or in a folder around it that is being read.
        stated: its path, relative to one of these or absolute.
        where: the file that states it, for messages.
        photograph: whose mask or depth is sought; these often have its name, so the end of a path may find it instead.

    Raises:
        PocketGSError: the path is not usable, or leaves the folder.
    """
    path = PureWindowsPath(stated)
    if not path.root:
        if file := existing_file(folder, with_slashes(stated), where):
            return file
        with suppress(PocketGSError):  # it leads out of a folder around
            files = (existing_file(place, with_slashes(stated), where) for place in folders_around(folder)[1:])
            return next(filter(None, files), None)
        return None
    parts = path.parts[1:][-DEEPEST - 1 :]
    relative, places = _relative(stated, folder), folders_around(folder)
    ends = [*([relative] if relative else []), *("/".join(parts[start:]) for start in range(len(parts)))]
    files = (existing_file(place, end, where) for end in ends for place in places)
    return next((file for file in files if file and not (photograph and file.samefile(photograph))), None)


def _relative(stated: str, folder: Path) -> str | None:
    """A stated path from the folder, if it is an absolute one of this machine that leads into it."""
    if not os.path.isabs(stated):
        return None
    roots = (f"{root}{os.sep}" for root in (os.path.abspath(folder), os.path.realpath(folder)))
    return next((stated.removeprefix(root) for root in roots if stated.startswith(root)), None)


def _of_the_name(present: dict[str, list[Path]], stated: str, suffixes: tuple[str, ...]) -> list[Path]:
    """The files whose names differ just in spelling."""
    name = spelling(_last_part(stated))
    return [file for suffix in suffixes for file in present.get(name + spelling(suffix), ())]


def _of_the_stem(present: dict[str, list[Path]], stated: str) -> list[Path]:
    """The files whose names differ just in spelling and suffix."""
    return present.get(os.path.splitext(spelling(_last_part(stated)))[0] + ANY_SUFFIX, [])


def _only(files: Sequence[Path]) -> Path | None:
    return files[0] if len(files) == 1 else None


def _kinds(named: Sequence[str], found: Sequence[object]) -> set[tuple[str, str]]:
    """The kinds of images some of which exist under their names, and so were not converted."""
    return {_kind(name) for name, file in zip(named, found, strict=True) if file}


def _kind(stated: str) -> tuple[str, str]:
    """The folder and the suffix of a stated path."""
    path = PureWindowsPath(spelling(stated))
    return str(path.parent), path.suffix


def _spelt_in(folder: Path) -> dict[str, list[Path]]:
    """The images directly in a folder, by their names; see `_by_spelling`."""
    return _by_spelling([file for file in list_images(folder) if not file.is_symlink()] if folder.is_dir() else [])


def _by_spelling(files: Sequence[Path]) -> dict[str, list[Path]]:
    """Files by normalised name and by normalised name with any suffix."""
    found: dict[str, list[Path]] = defaultdict(list)
    for file in files:
        found[spelling(file.name)].append(file)
        found[spelling(file.stem) + ANY_SUFFIX].append(file)
    return dict(found)


def _by_name_alone(present: Sequence[Path], named: Sequence[str], suffixes: tuple[str, ...]) -> list[Path | None]:
    """For each image, the file of its name whose folders match the stated ones best; None on a tie."""
    by_name = _by_spelling(present)
    own = [_of_the_name(by_name, name, suffixes) for name in named]
    unconverted = _kinds(named, own)
    candidates = (
        files if files or _kind(name) in unconverted else _of_the_stem(by_name, name)
        for name, files in zip(named, own, strict=True)
    )
    return [_best(files, name) for name, files in zip(named, candidates, strict=True)]


def _best(files: Sequence[Path], stated: str) -> Path | None:
    ranks = sorted((_rank(file, stated), file) for file in files)
    return None if not ranks or (len(ranks) > 1 and ranks[0][0] == ranks[1][0]) else ranks[0][1]


def _rank(file: Path, stated: str) -> tuple[int, bool]:
    """Sort key, lowest is best: number of matching path parts from the end, then full resolution first."""
    agreeing = 0
    for one, other in zip(reversed(file.parts), reversed(PureWindowsPath(stated).parts), strict=False):
        if agreeing and spelling(one) != spelling(other):
            break
        agreeing += 1
    return -agreeing, re.search(r"_\d+$", file.parent.name) is not None


def images_below(folder: Path, leave_out: Callable[[Path], bool]) -> list[Path]:
    """All images below a folder, except in folders of masks, depths and the like; links are not followed."""

    def is_searched(path: Path) -> bool:
        return is_folder_of_photographs(path) and not leave_out(path)

    found = []
    for place, folders, files in os.walk(folder):
        path = Path(place)
        deep = len(path.relative_to(folder).parts) >= DEEPEST
        folders[:] = [] if deep else sorted(name for name in folders if is_searched(path / name))
        found += [path / name for name in sorted(files) if is_image(path / name) and not (path / name).is_symlink()]
    return found


def _last_part(stated: str) -> str:
    """File name of a path with either separator: paths may come from Windows."""
    return PureWindowsPath(stated).name


def with_slashes(stated: str) -> str:
    """A path as written on Windows, with `/` as the separator."""
    return stated.replace("\\", "/")


def spelling(name: str) -> str:
    """A name without what differs between systems: case, and the encoding of accents."""
    return unicodedata.normalize("NFC", name).casefold()
