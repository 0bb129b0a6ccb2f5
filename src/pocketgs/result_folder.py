"""The folder that a run leaves behind: `scene.ply`, `run.json`, `checkpoint.npz`, pictures of the held-out views,
and `cameras.json`.

A run's files are gathered in a hidden folder and put in place together at its end: until then, and if the run fails or
is killed, an earlier result stays as it was.
"""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from PIL import Image

from pocketgs.atomic_file import remove_leftovers, replacing
from pocketgs.errors import PocketGSError
from pocketgs.gaussians import PARAMETERS, Gaussians
from pocketgs.splat.engine import OptimiserState
from pocketgs.training import Checkpoint

SCENE, RECORD, CHECKPOINT, PICTURES = "scene.ply", "run.json", "checkpoint.npz", "held_out"
CAMERAS = "cameras.json"
SHRINK = "shrink"
"""Where a checkpoint says by what whole factor the photographs of its run are smaller than asked for."""

UNFINISHED = "unfinished.npz"
"""Checkpoint of a run under way; it goes when the run's result is in place."""

LONGEST_PICTURE_NAME = 50

_STAGING = ".unpublished-"


@contextmanager
def publishing(folder: Path) -> Iterator[Path]:
    """Give an empty folder to write a result to; when the block succeeds, move what is in it to `folder`.

    If nothing comes of it, a folder that had to be made goes again.

    Raises:
        PocketGSError: the folder cannot be made or written to.
    """
    try:
        made = [path for path in (folder, *folder.parents) if not path.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        # What a killed run left behind.
        for leftover in folder.glob(f"{_STAGING}*"):
            shutil.rmtree(leftover, ignore_errors=True)
        staging = folder / f"{_STAGING}{uuid.uuid4().hex[:8]}"
        staging.mkdir()
    except OSError as error:
        raise PocketGSError(f"{folder}: cannot be written to ({error.strerror or error})") from error
    try:
        yield staging
        for item in sorted(staging.iterdir()):
            _move(item, folder / item.name)
    except OSError as error:
        raise PocketGSError(f"{folder}: the result cannot be written ({error.strerror or error})") from error
    finally:
        shutil.rmtree(staging, ignore_errors=True)
        with suppress(OSError):
            for path in made:
                path.rmdir()  # refuses if anything is in there


def _move(source: Path, target: Path) -> None:
    """Put a file or folder in place of whatever is there."""
    if target.is_dir() or (source.is_dir() and os.path.lexists(target)):
        # Only a file can replace a file in one go: move the old one aside, into the staging folder that goes away.
        os.replace(target, source.with_name(f"old-{source.name}"))
    os.replace(source, target)


def check_writable(folder: Path) -> None:
    """Find out before the work starts that a result can be written, and clear away what a killed run left behind.

    Raises:
        PocketGSError: it cannot.
    """
    with publishing(folder):
        remove_leftovers(folder / UNFINISHED)


def remove_outdated(folder: Path, keep_pictures: bool) -> None:
    """Delete what a new result did not replace: an earlier run's unfinished checkpoint and pictures."""
    (folder / UNFINISHED).unlink(missing_ok=True)
    if not keep_pictures:
        shutil.rmtree(folder / PICTURES, ignore_errors=True)


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write JSON atomically; numbers that JSON does not know, such as NaN, become null."""
    with replacing(path) as partial:
        partial.write_text(json.dumps(_plain(content), indent=2) + "\n", encoding="utf-8")


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value


def write_side_by_side(folder: Path, name: str, photo: np.ndarray, rendered: np.ndarray) -> None:
    """Write a picture with the photograph on the left and the rendering on the right.

    Args:
        folder: an existing folder.
        name: of the picture, without suffix; see `picture_names`.
        photo: (H, W, 3) uint8.
        rendered: (H, W, 3) float in [0, 1].
    """
    pair = np.concatenate([photo, np.round(rendered * 255.0).astype(np.uint8)], axis=1)
    Image.fromarray(pair).save(folder / f"{name}.png")


def picture_names(frames: Iterable[str]) -> list[str]:
    """Frames' names as plain file names without suffix, no two alike even where upper and lower case are the same."""
    names: list[str] = []
    taken: set[str] = set()
    for frame in frames:
        stem = re.sub(r"[^\w-]+", "_", str(PurePosixPath(frame).with_suffix(""))).strip("_")
        # File systems take names of 255 bytes, and a letter may need four; a name's end says most.
        stem = name = stem[-LONGEST_PICTURE_NAME:] or "frame"
        number = 1
        while name.casefold() in taken:
            number += 1
            name = f"{stem}_{number}"
        taken.add(name.casefold())
        names.append(name)
    return names


def write_checkpoint(path: Path, checkpoint: Checkpoint, run: dict[str, Any]) -> None:
    """Write what resuming needs, atomically.

    Args:
        path: ends in .npz.
        checkpoint: the run as it stands.
        run: what must be the same when it is resumed.
    """
    arrays = {name: getattr(checkpoint.gaussians, name) for name in PARAMETERS}
    with replacing(path) as partial:
        np.savez(
            partial,
            iteration=checkpoint.iteration,
            steps=checkpoint.state.steps,
            first_moments=checkpoint.state.first_moments,
            second_moments=checkpoint.state.second_moments,
            run=json.dumps(run, sort_keys=True),
            **arrays,
        )


def read_size(folder: Path) -> tuple[int, int]:
    """By what factor photographs are shrunk in the run of a folder's newest checkpoint, and how many Gaussians it has.

    Raises:
        PocketGSError: there is none, or it is broken.
    """
    path = _newest_checkpoint(folder)
    try:
        with np.load(path, allow_pickle=False) as data:
            return int(json.loads(str(data["run"]))[SHRINK]), len(data["opacity_logits"])
    except Exception as error:  # a damaged archive fails in many ways
        raise PocketGSError(f"{path}: not a readable checkpoint ({error})") from error


def read_checkpoint(folder: Path, run: dict[str, Any]) -> Checkpoint:
    """Read a folder's newest checkpoint: of a run that was under way there, or of the one that ended there.

    Args:
        folder: a run's folder.
        run: what must be the same as when it was written.

    Raises:
        PocketGSError: there is none, it is broken, or it belongs to another run.
    """
    path = _newest_checkpoint(folder)
    try:
        with np.load(path, allow_pickle=False) as data:
            written = dict(json.loads(str(data["run"])))
            gaussians = Gaussians(*(data[name] for name in PARAMETERS))
            state = OptimiserState(data["first_moments"], data["second_moments"], int(data["steps"]))
            iteration = int(data["iteration"])
    except Exception as error:  # a damaged archive fails in many ways
        raise PocketGSError(f"{path}: not a readable checkpoint ({error})") from error
    if iteration < 0 or state.steps < 0:
        raise PocketGSError(f"{path}: counts {iteration} iterations and {state.steps} steps, expected at least 0")
    columns = 10 + 3 * gaussians.sh.shape[1]
    for moments in (state.first_moments, state.second_moments):
        if moments.shape != (len(gaussians), columns) or moments.dtype != np.float32:
            raise PocketGSError(f"{path}: its moments are {moments.dtype} of shape {moments.shape}, not the scene's")
    for key, value in run.items():
        if written.get(key) != value:
            raise PocketGSError(f"{path}: belongs to a run with {key} {written.get(key)!r}, but this one has {value!r}")
    return Checkpoint(iteration, gaussians, state)


def _newest_checkpoint(folder: Path) -> Path:
    found = [path for path in (folder / UNFINISHED, folder / CHECKPOINT) if path.is_file()]
    if not found:
        raise PocketGSError(f"{folder}: holds no {UNFINISHED} or {CHECKPOINT} to resume from")
    return max(found, key=lambda path: path.stat().st_mtime_ns)
