"""The folder of captures: one folder for each, with names that the server chooses, and a trash.

FOLDER/captures/ID/about.json      what is known of it
FOLDER/captures/ID/upload/         its files as they arrive
FOLDER/captures/ID/capture/        an archive's content
FOLDER/captures/ID/result/         the result folder of `pocketgs train`
FOLDER/captures/ID/downloads/      the scene in other formats, once they were asked for
FOLDER/captures/ID/thumbnail.jpg
FOLDER/captures/ID/train.log       what the last run printed
FOLDER/trash/ID/                   the same, after it was deleted
FOLDER/.pocketgs/                  the lock, and the page's address
"""

from __future__ import annotations

import json
import math
import os
import secrets
import shutil
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from pocketgs.errors import PocketGSError
from pocketgs.files.atomic_file import replacing
from pocketgs.files.manifest import PRIVATE
from pocketgs.serve.entry import ID, Entry, read_entry

CAPTURES, TRASH = "captures", "trash"
ABOUT, UPLOAD, CAPTURE, RESULT, THUMBNAIL, LOG = (
    "about.json",
    "upload",
    "capture",
    "result",
    "thumbnail.jpg",
    "train.log",
)

RESERVE = 300_000_000
"""Bytes of the disk that uploads leave free: for thumbnails, results, and everything else on it."""

SECONDS_IN_TRASH = 7 * 24 * 3600.0
"""How long the trash keeps what was deleted."""


class Shelf:
    """The captures of a folder, in memory and on disk. Only one server at a time may use a folder.

    Args:
        folder: created if needed.

    Raises:
        PocketGSError: the folder cannot be used, or a link leads out of it.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder.resolve()
        self.warnings: list[str] = []
        for name in (CAPTURES, TRASH, PRIVATE):
            _make_real_folder(self.folder / name)
        self.entries = self._read(CAPTURES)
        self.deleted = self._read(TRASH)

    def place(self, entry: Entry) -> Path:
        """The folder of a capture.

        Raises:
            PocketGSError: something else has taken its place, such as a link.
        """
        place = self.folder / (TRASH if entry.deleted is not None else CAPTURES) / entry.id
        if place.resolve() != place or not place.is_dir():
            raise PocketGSError("the capture's folder is gone, or a link has taken its place")
        return place

    def add(self, entry: Entry) -> None:
        """Make the folder of a new capture.

        Raises:
            PocketGSError: it cannot be written.
            OSError: likewise.
        """
        place = self.folder / CAPTURES / entry.id
        try:
            (place / UPLOAD).mkdir(parents=True)
            self.save(entry)
        except (PocketGSError, OSError):
            self.entries.pop(entry.id, None)
            shutil.rmtree(place, ignore_errors=True)
            raise

    def save(self, entry: Entry) -> Entry:
        """Replace what is known of a capture, in memory even if the disk is full; returns it.

        Raises:
            PocketGSError: it cannot be written.
        """
        (self.entries if entry.deleted is None else self.deleted)[entry.id] = entry
        with replacing(self.place(entry) / ABOUT) as partial:
            partial.write_text(json.dumps(entry.to_json(), indent=1) + "\n", encoding="utf-8")
        return entry

    def change(self, entry: Entry) -> Entry:
        """As `save`, but what cannot be written is not changed in memory either: whoever asked for it can ask again.

        Raises:
            PocketGSError: it cannot be written.
        """
        before = self.entries[entry.id]
        try:
            return self.save(entry)
        except PocketGSError:
            self.entries[entry.id] = before
            raise

    def delete(self, entry: Entry) -> None:
        """Move a capture to the trash. One whose folder was taken away is forgotten."""
        if not os.path.lexists(self.folder / CAPTURES / entry.id):
            del self.entries[entry.id]
            return
        self._move(entry, replace(entry, deleted=time.time()), self.entries)

    def restore(self, entry: Entry) -> Entry:
        """Move a capture back from the trash; returns it as it was."""
        return self._move(entry, replace(entry, deleted=None), self.deleted)

    def empty_trash(self, seconds: float = -math.inf) -> list[Path]:
        """Take captures out of the trash for good.

        Args:
            seconds: that they must have been in it; all by default.

        Returns:
            Their folders, for `delete_folders`: that takes a while.
        """
        folders = []
        for entry in list(self.deleted.values()):
            if time.time() - (entry.deleted or 0.0) > seconds:
                with suppress(PocketGSError):  # a link, or nothing: there is nothing of ours to delete
                    folders.append(self.place(entry))
                del self.deleted[entry.id]
        return folders

    def received(self, entry: Entry) -> list[int]:
        """How many bytes of each of a capture's files have arrived: their sizes on disk."""
        folder = self.place(entry) / UPLOAD
        return [_size_of(folder / file.stored) for file in entry.files]

    def has_all(self, entry: Entry) -> bool:
        """Whether all of a capture's files are complete."""
        return self.received(entry) == [file.size for file in entry.files]

    def _move(self, entry: Entry, moved: Entry, source: dict[str, Entry]) -> Entry:
        target = self.folder / (TRASH if moved.deleted is not None else CAPTURES) / entry.id
        try:
            os.rename(self.place(entry), target)
        except OSError as error:
            raise PocketGSError(f"{entry.title}: its folder cannot be moved ({error.strerror or error})") from error
        del source[entry.id]
        with suppress(PocketGSError):  # a full disk is a reason to delete; where the folder lies is what counts
            self.save(moved)
        return moved

    def _read(self, name: str) -> dict[str, Entry]:
        found = {}
        for place in sorted((self.folder / name).iterdir()):
            if not ID.fullmatch(place.name) or place.is_symlink() or not (place / ABOUT).is_file():
                continue
            try:
                entry = read_entry(place / ABOUT)
            except PocketGSError as error:
                self.warnings.append(str(error))
                continue
            # A move that was cut off between the folder and its file: the folder decides.
            if name == CAPTURES:
                entry = replace(entry, deleted=None)
            elif entry.deleted is None:
                entry = replace(entry, deleted=time.time())
            found[entry.id] = entry
        return found


def delete_folders(folders: list[Path]) -> None:
    """Delete folders with all that they hold, as far as that is possible."""
    for folder in folders:
        shutil.rmtree(folder, ignore_errors=True)


def new_id() -> str:
    """The name of a new capture's folder: the time, and what tells captures of the same second apart."""
    return f"{time.strftime('%Y%m%d-%H%M%S')}-{secrets.token_hex(3)}"


def input_of(folder: Path, entry: Entry) -> Path:
    """What `pocketgs train` is given of a capture in this folder: a folder, or a file."""
    if entry.kind == "photographs":
        return folder / UPLOAD
    stored = entry.files[0].stored
    return folder / CAPTURE if stored.endswith(".zip") else folder / UPLOAD / stored


def free_bytes(folder: Path) -> int:
    """How many bytes uploads and archives may add to a folder's disk, below 0 if it is too full already."""
    return shutil.disk_usage(folder).free - RESERVE


def _size_of(path: Path) -> int:
    with suppress(OSError):
        return path.lstat().st_size
    return 0


def _make_real_folder(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PocketGSError(f"{path}: cannot be made ({error.strerror or error})") from error
    if path.resolve() != path:
        raise PocketGSError(f"{path}: is a link, expected a folder, since what is uploaded must stay in {path.parent}")
