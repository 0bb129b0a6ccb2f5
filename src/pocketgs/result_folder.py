"""The folder that a run leaves behind: `scene.ply`, `run.json`, `checkpoint.npz`, pictures of the held-out views,
and `cameras.json`.

A run's files are gathered in a hidden folder and put in place together at its end, see `pocketgs.publishing`: until
then, and if the run fails or is killed, an earlier result stays as it was.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from pocketgs.atomic_file import remove_leftovers, replacing
from pocketgs.errors import PocketGSError
from pocketgs.gaussians import PARAMETERS, Gaussians
from pocketgs.publishing.claim import Claim, claimed
from pocketgs.publishing.journal import settle
from pocketgs.publishing.manifest import read_manifest
from pocketgs.splat.engine import OptimiserState

if TYPE_CHECKING:
    from pocketgs.training import Checkpoint

SCENE, RECORD, CHECKPOINT, PICTURES = "scene.ply", "run.json", "checkpoint.npz", "held_out"
CAMERAS = "cameras.json"
SHRINK = "shrink"
"""Where a checkpoint says by what whole factor the photographs of its run are smaller than asked for."""

UNFINISHED = "unfinished.npz"
"""Checkpoint of a run under way; it goes when the run's result is in place."""

LONGEST_PICTURE_NAME = 50

FILES = (SCENE, RECORD, CHECKPOINT, CAMERAS)
"""What every result has."""


@contextmanager
def claimed_for_run(folder: Path, source: str | None = None) -> Iterator[Claim]:
    """Claim a folder for a run's result: nobody else writes there meanwhile, and nothing of anybody else's is lost.

    Args:
        folder: made if need be.
        source: what tells the run's capture from others of its name, see `pocketgs.publishing.manifest.source_of`.

    Raises:
        PocketGSError: the folder cannot be used.
    """
    with claimed(folder, (*FILES, f"{PICTURES}/*.png"), source) as claim:
        remove_leftovers(folder / UNFINISHED)
        if os.path.lexists(folder / UNFINISHED) and not _is_checkpoint(folder / UNFINISHED):
            raise PocketGSError(f"{folder / UNFINISHED}: is no checkpoint of ours, expected it moved away")
        yield claim


@contextmanager
def publishing(folder: Path, names: Iterable[str] = ()) -> Iterator[Path]:
    """Claim a folder, give an empty one to write to, and when the block succeeds put what is in it in place as one.

    Args:
        folder: made if need be.
        names: files that the block is to write, so that one of somebody else in their way is found out at once.

    Raises:
        PocketGSError: the folder cannot be used.
    """
    with claimed(folder, names) as claim, claim.publishing() as staging:
        yield staging


def check_free_for(folder: Path, source: str) -> None:
    """Refuse to let the result of one capture take the place of another's that happens to have the same name.

    Args:
        folder: that the capture's name has led to.
        source: what tells the capture from others, see `pocketgs.publishing.manifest.source_of`.

    Raises:
        PocketGSError: the folder holds the result of another capture.
    """
    settle(folder)
    before = read_manifest(folder).source
    if before is not None and before != source:
        found = "holds the result of another capture of this name, or of this one at another place"
        raise PocketGSError(f"{folder}: {found}; expected --output {folder} to replace it, or another folder there")


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


def _is_checkpoint(path: Path) -> bool:
    try:
        with np.load(path, allow_pickle=False) as data:
            return {"run", "first_moments", *PARAMETERS} <= set(data)
    except Exception:  # a file that is something else fails in many ways
        return False


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
    # Most who want something of this module do not train, which takes a second to load.
    from pocketgs.training import Checkpoint

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
