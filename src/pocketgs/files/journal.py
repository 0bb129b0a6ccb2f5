"""Publishing several files as one, with a journal: an interrupted move is completed or undone by the next command.

A command writes its files to a staging folder. Renaming that folder to `PENDING` is the commit: before it the folder
holds the earlier result, after it the new one. Then the files move to their places one by one, and the files that they
replace move into `PENDING`. If the process dies in between, `PENDING` remains, and the next command that reads or
writes the folder completes the move first. If a file cannot be replaced, all moves are undone.
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
"""Prefix of staging folders, which are garbage once their owner has ended."""

NEW, OLD, PLAN = "new", "old", "plan.json"
"""Inside a staging folder: new files, the files that they replace, and the plan."""

KEPT = "unpublished-"
"""Prefix of a folder that holds a complete result which could not be published."""

PATIENCE = 10.0
"""Seconds that a reader waits for another process to publish its result, which takes milliseconds."""


@dataclass(frozen=True)
class Plan:
    """Changes to the files of a folder. Paths are relative to it.

    Attributes:
        put: files to move in, over existing ones.
        remove: files to remove.
    """

    put: list[str]
    remove: list[str]


def new_staging(folder: Path) -> Path:
    """Make an empty staging folder, with `NEW` in it for a command's files."""
    staging = folder / f"{STAGING}{uuid.uuid4().hex[:8]}"
    (staging / NEW).mkdir(parents=True)
    return staging


def remove_staging(folder: Path) -> None:
    """Delete staging folders. The caller holds the folder's lock, so nobody uses them."""
    for leftover in folder.glob(f"{STAGING}*"):
        shutil.rmtree(leftover, ignore_errors=True)


def publish(folder: Path, staging: Path, before: Manifest, outdated: Iterable[str]) -> None:
    """Publish the files in `NEW` to the folder.

    Args:
        folder: the output folder; the caller holds its lock.
        staging: from `new_staging`.
        before: says which files in the folder may be replaced.
        outdated: files to remove unless new ones replace them.

    Raises:
        PocketGSError: a file cannot be replaced. The folder keeps the earlier result; the new one is kept elsewhere.
        OSError: the new result cannot be flushed to disk, and is not kept.
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
    """Complete a publication that a dead process left half done. Call it before reading the folder.

    Raises:
        PocketGSError: it cannot be completed, or another process that is completing it takes too long.
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
    """`settle` for a caller who holds the folder's lock."""
    if os.path.isdir(folder / PENDING):
        _complete(folder)


def _complete(folder: Path) -> None:
    """Move all files to their places, or none."""
    pending = folder / PENDING
    plan = _read_plan(pending)
    try:
        _put_in_place(folder, pending, plan)
    except BaseException as error:
        kept = _take_back(folder, pending, plan)
        if isinstance(error, OSError):
            reason = f"{error.filename or folder}: {error.strerror or error}"
            message = f"{folder}: the new result cannot replace the earlier one ({reason}); it is in {kept}"
            raise PocketGSError(message) from error
        raise


def _read_plan(pending: Path) -> Plan:
    try:
        document = json.loads((pending / PLAN).read_text(encoding="utf-8"))
        return Plan(list(document["put"]), list(document["remove"]))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise _cannot_complete(pending.parent.parent, error) from error


def _cannot_complete(folder: Path, error: Exception) -> PocketGSError:
    return PocketGSError(f"{folder}: a half-published result there cannot be completed ({error})")


def _put_in_place(folder: Path, pending: Path, plan: Plan) -> None:
    """Move new files in and old ones out, skipping those that an earlier process has already moved."""
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
    # What remains is garbage from here on; this rename marks it so.
    rubbish = folder / f"{STAGING}{uuid.uuid4().hex[:8]}"
    os.rename(pending, rubbish)
    shutil.rmtree(rubbish, ignore_errors=True)
    _remove_empty_folders(folder, plan.remove)


def _take_back(folder: Path, pending: Path, plan: Plan) -> Path:
    """Undo `_put_in_place`, however far it came. Returns the folder that then holds the new result.

    Raises:
        PocketGSError: a file cannot be moved back.
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
    """Move the new result to a folder of its own, and delete the rest of the staging folder."""
    kept = folder / f"{KEPT}{uuid.uuid4().hex[:8]}"
    os.rename(staging / NEW, kept)
    shutil.rmtree(staging, ignore_errors=True)
    return kept


def _move(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    os.replace(source, target)


def _remove_empty_folders(folder: Path, names: Iterable[str]) -> None:
    """Delete the folders of removed files, and those around them, if they are empty now."""
    parents = {folder / above for name in names for above in Path(name).parents[:-1]}
    for parent in sorted(parents, reverse=True):
        with suppress(OSError):
            parent.rmdir()


def _bring_to_disk(staging: Path) -> None:
    """Flush files to disk: a rename may reach the disk before the content, and a power cut would leave empty files."""
    for name in files_below(staging):
        with (staging / name).open("rb+") as file:
            os.fsync(file.fileno())
    for path in staging.rglob("*"):
        if path.is_dir():
            _sync(path)
    _sync(staging)


def _sync(folder: Path) -> None:
    """Flush a folder's entries to disk, where the system can."""
    with suppress(OSError):  # Windows cannot open folders
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
