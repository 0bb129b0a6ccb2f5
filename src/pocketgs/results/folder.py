"""The folder that a run leaves behind: `scene.ply`, `run.json`, `checkpoint.npz`, pictures of the held-out views,
`cameras.json`, and pictures of what moved between the photographs, if anything did.

A run's files are written to a hidden folder and published together at its end, see `pocketgs.files.journal`: if the run
fails or is killed, an earlier result stays as it was.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from pocketgs.capture.capture import Frame
from pocketgs.capture.open import capture_name
from pocketgs.errors import PocketGSError
from pocketgs.files.atomic_file import remove_leftovers, replacing
from pocketgs.files.journal import settle
from pocketgs.files.manifest import read_manifest
from pocketgs.files.plain_names import plain_names
from pocketgs.results.checkpoint import CHECKPOINT, UNFINISHED, is_checkpoint
from pocketgs.results.claim import Claim, claimed
from pocketgs.training.transients import pixels_of

SCENE, RECORD, PICTURES = "scene.ply", "run.json", "held_out"
TRANSIENTS = "transients"
CAMERAS = "cameras.json"
COMPRESSED = "scene.pgs"
"""The compressed scene, which a run writes only if it is asked to."""

FILES = (SCENE, RECORD, CHECKPOINT, CAMERAS)
"""Files of every result."""

POSED = "posed"


def posed_folder(result: Path, capture: Path) -> Path:
    """The place in a result folder for the capture that is made of photographs or a video without poses."""
    return result / POSED / capture_name(capture)


@contextmanager
def claimed_for_run(folder: Path, source: str | None = None) -> Iterator[Claim]:
    """Claim a folder for a run's result: other processes are locked out, and other programs' files are not overwritten.

    Args:
        folder: created if needed.
        source: identifies the run's capture, see `pocketgs.files.manifest.source_of`.

    Raises:
        PocketGSError: the folder cannot be used.
    """
    with claimed(folder, (*FILES, COMPRESSED, f"{PICTURES}/*.png", f"{TRANSIENTS}/*.png"), source) as claim:
        remove_leftovers(folder / UNFINISHED)
        if os.path.lexists(folder / UNFINISHED) and not is_checkpoint(folder / UNFINISHED):
            raise PocketGSError(f"{folder / UNFINISHED}: is not a checkpoint of ours, expected it moved away")
        yield claim


@contextmanager
def publishing(folder: Path, names: Iterable[str] = (), outdated: Sequence[str] = ()) -> Iterator[Path]:
    """Claim a folder, yield an empty one to write to, and publish its content as one when the block succeeds.

    Args:
        folder: created if needed.
        names: files that the block will write, so that a file in the way is reported before the work.
        outdated: patterns of files to delete if a command wrote them and the block does not, see `Claim.publishing`.

    Raises:
        PocketGSError: the folder cannot be used.
    """
    with claimed(folder, names, outdated=outdated) as claim, claim.publishing(outdated=outdated) as staging:
        yield staging


def publishing_pictures(folder: Path, names: Iterable[str]) -> AbstractContextManager[Path]:
    """`publishing` for pictures with these names directly in a folder, in place of those of an earlier command.

    Raises:
        PocketGSError: as `publishing`.
    """
    return publishing(folder, names, ["/*.png"])


def check_compressed(folder: Path) -> None:
    """Check that a result's compressed scene can be written, before the work.

    Raises:
        PocketGSError: another program's file is in the way, or another process uses the folder.
    """
    with claimed(folder, [COMPRESSED]):
        pass


def write_compressed(folder: Path, contents: bytes) -> None:
    """Write a result's compressed scene.

    Raises:
        PocketGSError: it cannot be written.
    """
    with publishing(folder, [COMPRESSED]) as staging:
        (staging / COMPRESSED).write_bytes(contents)


def check_free_for(folder: Path, source: str) -> None:
    """Check that a result does not replace that of another capture with the same name.

    Args:
        folder: chosen by the capture's name.
        source: identifies the capture, see `pocketgs.files.manifest.source_of`.

    Raises:
        PocketGSError: the folder holds the result of another capture.
    """
    settle(folder)
    before = read_manifest(folder).source
    if before is not None and before != source:
        found = "holds the result of another capture of this name, or of this one at another path"
        raise PocketGSError(f"{folder}: {found}; expected --output {folder} to replace it, or another folder there")


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write JSON atomically; NaN and infinity become null."""
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


def write_transients(folder: Path, frames: Sequence[Frame], cells: Sequence[np.ndarray]) -> None:
    """Write each training photograph with transients to a folder in the given one; red is what was left out.

    Args:
        folder: an existing folder.
        frames: the training views.
        cells: (h, w) bool for each, see `pocketgs.training.transients`.
    """
    for frame, name, left_out in zip(frames, plain_names(frame.name for frame in frames), cells, strict=True):
        if left_out.any():
            (folder / TRANSIENTS).mkdir(exist_ok=True)
            picture, moved = frame.image.copy(), pixels_of(left_out, frame)
            picture[moved] //= 3
            picture[moved, 0] += 170
            Image.fromarray(picture).save(folder / TRANSIENTS / f"{name}.png")


def write_side_by_side(folder: Path, name: str, photo: np.ndarray, rendered: np.ndarray) -> None:
    """Write a photograph (left) and a rendering (right) as one image.

    Args:
        folder: an existing folder.
        name: of the image, without suffix; see `pocketgs.files.plain_names`.
        photo: (H, W, 3) uint8.
        rendered: (H, W, 3) float in [0, 1].
    """
    pair = np.concatenate([photo, np.round(rendered * 255.0).astype(np.uint8)], axis=1)
    Image.fromarray(pair).save(folder / f"{name}.png")
