"""Putting many files in place as one: what is half done is completed, or taken back, by whoever comes next.

A command gathers its files in a staging folder. One rename of that folder to `PENDING` decides: before it, the folder
holds the earlier result, and after it the new one. Only then do the files move to their places one by one; the files
that they replace wait inside `PENDING`. A process that dies in between leaves `PENDING`, and every command that reads
or writes the folder first goes on from there. Where a file refuses to be replaced, all that has been moved goes back.
"""

from __future__ import annotations

import json
import os
import shutil
import time
import uuid
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from pocketgs.errors import PocketGSError
from pocketgs.files.lock import InUseError, locked
from pocketgs.files.manifest import MANIFEST, PRIVATE, Manifest, files_below

LOCK = f"{PRIVATE}/lock"
PENDING = f"{PRIVATE}/pending"
STAGING = f"{PRIVATE}/staging-"
"""How the names of folders begin that nobody needs any more once their owner is gone."""

NEW, OLD, PLAN = "new", "old", "plan.json"
"""Inside a staging folder: the files to come, those that make way for them, and which both are."""

KEPT = "unpublished-"
"""How the name of a folder begins that holds a whole result which could not be put in place."""

PATIENCE = 10.0
"""Seconds that a reader waits for another process to put its result in place, which takes milliseconds."""


@dataclass(frozen=True)
class Plan:
    """What happens to the files of a folder, by their paths in it.

    Attributes:
        put: files that come, in place of what is there.
        remove: files that go.
    """

    put: list[str]
    remove: list[str]


def new_staging(folder: Path) -> Path:
    """An empty staging folder, with `NEW` in it for a command's files."""
    staging = folder / f"{STAGING}{uuid.uuid4().hex[:8]}"
    (staging / NEW).mkdir(parents=True)
    return staging


def remove_staging(folder: Path) -> None:
    """Delete staging folders; the caller holds the folder's lock, so that they are nobody's."""
    for leftover in folder.glob(f"{STAGING}*"):
        shutil.rmtree(leftover, ignore_errors=True)


def publish(folder: Path, staging: Path, before: Manifest, outdated: Iterable[str]) -> None:
    """Make what is in `NEW` the folder's content.

    Args:
        folder: to change; the caller holds its lock.
        staging: from `new_staging`.
        before: says what in the folder may be replaced.
        outdated: files of the folder that go, unless new ones come in their place.

    Raises:
        PocketGSError: a file cannot be put in place. The folder holds the earlier result, and the new one is kept.
        OSError: the new result cannot be made safe on the disk, and is not kept.
    """
    put = files_below(staging / NEW)
    plan = Plan(put, sorted(set(outdated) - set(put)))
    (staging / PLAN).write_text(json.dumps(asdict(plan)), encoding="utf-8")
    _bring_to_disk(staging)
    try:
        before.check_ours(folder, (name for name in (*plan.put, *plan.remove) if name != MANIFEST))
    except PocketGSError as error:
        raise PocketGSError(f"{error}; the new result is in {_keep(folder, staging)}") from error
    os.rename(staging, folder / PENDING)
    _sync(folder / PRIVATE)
    _complete(folder)


def settle(folder: Path) -> None:
    """Complete what a process that is gone has left half done in a folder; to be called before reading there.

    Raises:
        PocketGSError: it cannot be completed, or another process that is doing so takes too long.
    """
    deadline = time.monotonic() + PATIENCE
    while os.path.isdir(folder / PENDING):
        try:
            with locked(folder / LOCK, folder):
                complete_pending(folder)
                return
        except InUseError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.02)
        except OSError as error:
            raise _cannot_complete(folder, error) from error


def complete_pending(folder: Path) -> None:
    """As `settle`, for a caller who holds the folder's lock."""
    if os.path.isdir(folder / PENDING):
        _complete(folder)


def _complete(folder: Path) -> None:
    """Put everything in place, or else nothing."""
    pending = folder / PENDING
    plan = _read_plan(pending)
    try:
        _put_in_place(folder, pending, plan)
    except BaseException as error:
        kept = _take_back(folder, pending, plan)
        if isinstance(error, OSError):
            reason = f"{error.filename or folder}: {error.strerror or error}"
            message = f"{folder}: the new result cannot take the earlier one's place ({reason}); it is in {kept}"
            raise PocketGSError(message) from error
        raise


def _read_plan(pending: Path) -> Plan:
    try:
        document = json.loads((pending / PLAN).read_text(encoding="utf-8"))
        return Plan(list(document["put"]), list(document["remove"]))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise _cannot_complete(pending.parent.parent, error) from error


def _cannot_complete(folder: Path, error: Exception) -> PocketGSError:
    return PocketGSError(f"{folder}: a result is half in place there and cannot be completed ({error})")


def _put_in_place(folder: Path, pending: Path, plan: Plan) -> None:
    """Move new files in and old ones out; those that were moved before a kill are no longer where they came from."""
    for name in plan.remove:
        if os.path.lexists(folder / name):
            _move(folder / name, pending / OLD / name)
    for name in plan.put:
        if os.path.lexists(pending / NEW / name):
            if os.path.lexists(folder / name):
                _move(folder / name, pending / OLD / name)
            _move(pending / NEW / name, folder / name)
    for changed in {(folder / name).parent for name in (*plan.put, *plan.remove)}:
        _sync(changed)
    # What is left of it is rubbish from here on: one rename says so.
    rubbish = folder / f"{STAGING}{uuid.uuid4().hex[:8]}"
    os.rename(pending, rubbish)
    shutil.rmtree(rubbish, ignore_errors=True)
    _remove_empty_folders(folder, plan.remove)


def _take_back(folder: Path, pending: Path, plan: Plan) -> Path:
    """Undo `_put_in_place`, from wherever it has come to; where the new result is then.

    Raises:
        PocketGSError: what was moved cannot be moved back.
    """
    try:
        for name in (*plan.put, *plan.remove):
            if name in plan.put and not os.path.lexists(pending / NEW / name) and os.path.lexists(folder / name):
                _move(folder / name, pending / NEW / name)
            if os.path.lexists(pending / OLD / name):
                _move(pending / OLD / name, folder / name)
        _remove_empty_folders(folder, plan.put)
        rubbish = folder / f"{STAGING}{uuid.uuid4().hex[:8]}"
        os.rename(pending, rubbish)
        return _keep(folder, rubbish)
    except OSError as error:
        raise _cannot_complete(folder, error) from error


def _keep(folder: Path, staging: Path) -> Path:
    """Put the new result into a folder of its own, and delete what is left of the staging folder."""
    kept = folder / f"{KEPT}{uuid.uuid4().hex[:8]}"
    os.rename(staging / NEW, kept)
    shutil.rmtree(staging, ignore_errors=True)
    return kept


def _move(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    os.replace(source, target)


def _remove_empty_folders(folder: Path, names: Iterable[str]) -> None:
    """Delete the folders of files that have gone, unless something else is in them."""
    for parent in sorted({(folder / name).parent for name in names} - {folder}, reverse=True):
        with suppress(OSError):
            parent.rmdir()


def _bring_to_disk(staging: Path) -> None:
    """A rename may reach the disk before what was written: a power cut would leave empty files."""
    for name in files_below(staging):
        with (staging / name).open("rb+") as file:
            os.fsync(file.fileno())
    for path in staging.rglob("*"):
        if path.is_dir():
            _sync(path)
    _sync(staging)


def _sync(folder: Path) -> None:
    """Bring a folder's names to the disk, where the system can."""
    with suppress(OSError):  # Windows opens no folders
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
