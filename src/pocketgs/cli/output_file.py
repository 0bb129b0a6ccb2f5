"""The place of a file that a command will write after long work, and what may be replaced there."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from pocketgs.errors import PocketGSError
from pocketgs.files.atomic_file import replacing
from pocketgs.files.json_fields import read_json
from pocketgs.files.manifest import read_manifest
from pocketgs.results.folder import SCENE
from pocketgs.scene.formats.recognition import is_scene


@dataclass(frozen=True)
class Kind:
    """What a command writes.

    Attributes:
        what: in words, as in "not a scene".
        recognises: whether an existing file is of this kind. May raise OSError or PocketGSError instead of False.
    """

    what: str
    recognises: Callable[[Path], bool]


def _is_written_video(path: Path) -> bool:
    # Imported here because FFmpeg's libraries are slow to load.
    from pocketgs.results.video import is_written_video

    return is_written_video(path)


SCENE_FILE = Kind("a scene", is_scene)
VIDEO_FILE = Kind("a video that this version of render wrote", _is_written_video)


def json_with(what: str, *keys: str) -> Kind:
    """The kind of JSON files with certain keys."""
    return Kind(what, lambda path: set(keys) <= set(read_json(path).values))


def check_place(output: Path, kind: Kind, inputs: Iterable[Path]) -> None:
    """Refuse a place where no file can be written, or where one must stay, before the work.

    Args:
        output: where the command will write.
        kind: of what it will write.
        inputs: files and result folders that it reads.

    Raises:
        PocketGSError: it is a folder, or in a folder that does not exist or cannot be written to, or
            `check_replaceable` raises.
    """
    if output.is_dir() or not output.parent.is_dir():
        found = "is a folder" if output.is_dir() else "its folder does not exist"
        raise PocketGSError(f"{output}: {found}, expected the name of a file in an existing folder")
    check_replaceable(output, kind, inputs)
    check_writable(output)


class _TrialError(Exception):
    """Ends a trial before anything is replaced."""


def check_writable(output: Path) -> None:
    """Check that a file can be written, by an empty one beside it that does not stay.

    Raises:
        PocketGSError: it cannot.
    """
    with suppress(_TrialError), replacing(output) as partial:
        partial.touch()
        raise _TrialError


def make_writable(folder: Path) -> None:
    """Make a folder if there is none, and check that files can be written to it.

    Raises:
        PocketGSError: it cannot be made, or they cannot.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PocketGSError(f"{folder}: cannot be made ({error.strerror or error})") from error
    trial = folder / "trial"
    try:
        check_writable(trial)
    except PocketGSError as error:
        raise PocketGSError(str(error).replace(str(trial), str(folder))) from error


def check_replaceable(output: Path, kind: Kind, inputs: Iterable[Path]) -> None:
    """Refuse to replace a file other than an earlier one of the same kind.

    A file that the command reads stays, and so do the files of a result, which belong together. An empty file may be
    replaced.

    Args:
        output: where the command will write; there may be no such file.
        kind: of what it will write.
        inputs: files and result folders that it reads.

    Raises:
        PocketGSError: an existing file has to stay.
    """
    if not output.exists():
        return
    expected = "expected another name for the output"
    read = (each / SCENE if each.is_dir() else each for each in inputs)
    if any(each.is_file() and each.samefile(output) for each in read):
        raise PocketGSError(f"{output}: is what the command reads, {expected}")
    result = _result_with(output)
    if result is not None:
        raise PocketGSError(f"{output}: belongs to the result in {result}, {expected}")
    try:
        is_kind = output.is_file() and (output.stat().st_size == 0 or kind.recognises(output))
    except (OSError, PocketGSError):
        is_kind = False
    if not is_kind:
        raise PocketGSError(f"{output}: is there already and not {kind.what}, so that it is not replaced; {expected}")


def _result_with(output: Path) -> Path | None:
    """The folder whose manifest lists a file, if any does."""
    place = Path(os.path.abspath(output))
    for folder in place.parents:
        if place.relative_to(folder).as_posix() in read_manifest(folder).files:
            return folder
    return None
