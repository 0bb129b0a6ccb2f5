"""Checkpoints, from which a run can be resumed."""

from __future__ import annotations

import json
import time
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.files.atomic_file import replacing
from pocketgs.files.memory_bound import require_memory
from pocketgs.scene.gaussians import PARAMETERS, Gaussians
from pocketgs.splat.engine import OptimiserState
from pocketgs.splat.parameters import ParameterLayout
from pocketgs.splat.rows import Statistics
from pocketgs.training.progress import Progress
from pocketgs.training.result import Checkpoint
from pocketgs.training.validation import ValidationHistory, ValidationSample

CHECKPOINT = "checkpoint.npz"
SHRINK = "shrink"
"""Key of the integer factor by which the run's photographs are reduced further than requested."""

MAX_GAUSSIANS = "planned gaussians"
"""Key of the maximum number of Gaussians of the run."""

SH_DEGREE = "SH degree"
"""Key of the degree of the spherical harmonics."""

SEEDS = "seeds"
"""Key of the shape of the seeds."""

TRAINING_CAMERAS = "training cameras"
"""Key of the digest of the training views' names and poses, as the capture's files give them."""

INTRINSICS = "intrinsics"
"""Key of the digest of the training views' focal lengths, principal points and lenses."""

LATER = frozenset({SEEDS, TRAINING_CAMERAS, INTRINSICS})
"""Keys that older checkpoints lack: what they do not tell is taken to be the same."""

STATISTICS = tuple(field.name for field in fields(Statistics))

SECONDS_BETWEEN_CHECKPOINTS = 60.0

PAUSE = 10.0
"""Minimum time between two checkpoints, relative to what writing the first one took: a slow disk stops no training."""

UNFINISHED = "unfinished.npz"
"""Checkpoint of an unfinished run; deleted when the result is complete."""


def write_checkpoint(path: Path, checkpoint: Checkpoint, run: dict[str, Any]) -> None:
    """Write a checkpoint atomically.

    Args:
        path: ends in .npz.
        checkpoint: state of the run.
        run: what must be the same when it is resumed.
    """
    arrays = {name: getattr(checkpoint.gaussians, name) for name in PARAMETERS}
    if checkpoint.statistics is not None:
        arrays |= {name: getattr(checkpoint.statistics, name) for name in STATISTICS}
    if checkpoint.history is not None:
        arrays["course"] = np.array(_written_history(checkpoint.history))
    if checkpoint.state.colours is not None:
        arrays["colours"] = checkpoint.state.colours
    if checkpoint.transients is not None:
        arrays["transient_shapes"] = np.array([cells.shape for cells in checkpoint.transients], np.int32)
        arrays["transients"] = np.packbits(np.concatenate([cells.ravel() for cells in checkpoint.transients]))
    if checkpoint.state.near is not None:
        arrays["near"] = np.float64(checkpoint.state.near)
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


@contextmanager
def _arrays(path: Path, *names: str) -> Iterator[Any]:
    """The arrays of a checkpoint: all, or those with these names.

    The memory bound is checked, since a small file can unpack to any size.
    """
    with zipfile.ZipFile(path) as archive:
        members = [each for each in archive.infolist() if not names or Path(each.filename).stem in names]
    unpacked = sum(member.file_size for member in members)
    require_memory(path, unpacked, f"unpacking {unpacked:,} bytes")
    with np.load(path, allow_pickle=False) as data:
        yield data


def is_checkpoint(path: Path) -> bool:
    """Whether a file is a checkpoint that `write_checkpoint` wrote."""
    try:
        with zipfile.ZipFile(path) as archive:
            return {"run", "first_moments", *PARAMETERS} <= {Path(name).stem for name in archive.namelist()}
    except Exception:  # other files fail in many ways
        return False


def read_size(folder: Path) -> tuple[int, int]:
    """The factor by which a folder's newest checkpoint reduces photographs, and its maximum number of Gaussians.

    Raises:
        PocketGSError: there is none, or it is broken.
    """
    path = _newest_checkpoint(folder)
    try:
        with _arrays(path) as data:
            run, count = json.loads(str(data["run"])), len(data["opacity_logits"])
            return int(run[SHRINK]), max(int(run[MAX_GAUSSIANS]), count)
    except Exception as error:  # a damaged archive fails in many ways
        raise PocketGSError(f"{path}: not a readable checkpoint ({error})") from error


def read_transients(path: Path) -> tuple[np.ndarray, ...] | None:
    """The (h, w) bool cells of each training view that a run left out, see `pocketgs.training.transients`.

    Args:
        path: of the run's checkpoint.

    Returns:
        None if the run did not look for transients.

    Raises:
        PocketGSError: the file cannot be read.
    """
    try:
        with _arrays(path, "transients", "transient_shapes") as data:
            return _transients(data) if "transients" in data else None
    except Exception as error:  # a damaged archive fails in many ways
        raise PocketGSError(f"{path}: not a readable checkpoint ({error})") from error


def read_checkpoint(folder: Path, run: dict[str, Any]) -> Checkpoint:
    """Read a folder's newest checkpoint, of an unfinished or a finished run.

    Args:
        folder: a run's folder.
        run: what must be the same as when it was written.

    Raises:
        PocketGSError: there is none, it is broken, or it belongs to another run.
    """
    path = _newest_checkpoint(folder)
    try:
        with _arrays(path) as data:
            written = dict(json.loads(str(data["run"])))
            gaussians = Gaussians(*(data[name] for name in PARAMETERS))
            written[SH_DEGREE] = gaussians.sh_degree  # older checkpoints have none where the recipe decided
            near = float(data["near"]) if "near" in data else None
            colours = data.get("colours")
            state = OptimiserState(data["first_moments"], data["second_moments"], int(data["steps"]), near, colours)
            statistics = Statistics(*(data[name] for name in STATISTICS)) if STATISTICS[0] in data else None
            iteration = int(data["iteration"])
            history = _history(json.loads(str(data["course"]))) if "course" in data else None
            transients = _transients(data) if "transients" in data else None
    except Exception as error:  # a damaged archive fails in many ways
        raise PocketGSError(f"{path}: not a readable checkpoint ({error})") from error
    if iteration < 0 or state.steps < 0:
        raise PocketGSError(f"{path}: counts {iteration} iterations and {state.steps} steps, expected at least 0")
    columns = ParameterLayout(gaussians.sh.shape[1]).columns
    for moments in (state.first_moments, state.second_moments):
        if moments.shape != (len(gaussians), columns) or moments.dtype != np.float32:
            raise PocketGSError(f"{path}: its moments are {moments.dtype} of shape {moments.shape}, not the scene's")
    for name in STATISTICS if statistics is not None else ():
        sums = getattr(statistics, name)
        if sums.shape != (len(gaussians),) or sums.dtype != np.float32:
            raise PocketGSError(f"{path}: its {name} are {sums.dtype} of shape {sums.shape}, not the scene's")
    _require_same_run(path, written, run)
    return Checkpoint(iteration, gaussians, state, statistics, history, transients)


def _require_same_run(path: Path, written: dict[str, Any], run: dict[str, Any]) -> None:
    """Refuse to resume a run with other options, or on another capture.

    Raises:
        PocketGSError: something in `run` is not as it was written.
    """
    told = (key for key in run if key in written or key not in LATER)
    differing = {key: run[key] for key in told if written.get(key) != run[key]}
    others = {key for key in (TRAINING_CAMERAS, INTRINSICS) if differing.pop(key, None)}
    for key, value in differing.items():
        raise PocketGSError(f"{path}: belongs to a run with {key} {written.get(key)!r}, but this one has {value!r}")
    if others:
        what = "other photographs, or on other poses or another order of these"
        raise PocketGSError(
            f"{path}: belongs to a run on {what if TRAINING_CAMERAS in others else 'other focal lengths or lenses'}; "
            "expected the capture that it was trained on, or another --output without --resume"
        )


def _written_history(history: ValidationHistory) -> str:
    return json.dumps({"looks": [asdict(sample) for sample in history.samples], "decays_from": history.decays_from})


def _history(written: dict[str, Any]) -> ValidationHistory:
    samples = (
        ValidationSample(int(each["iteration"]), float(each["psnr"]), int(each["gaussians"]), float(each["seconds"]))
        for each in written["looks"]
    )
    decays_from = written["decays_from"]
    return ValidationHistory(tuple(samples), None if decays_from is None else int(decays_from))


def _transients(data: Mapping[str, np.ndarray]) -> tuple[np.ndarray, ...]:
    shapes = data["transient_shapes"].astype(np.int64)
    sizes = shapes.prod(axis=1)
    cells = np.split(np.unpackbits(data["transients"], count=int(sizes.sum())), np.cumsum(sizes)[:-1])
    return tuple(part.astype(np.bool_).reshape(shape) for part, shape in zip(cells, shapes, strict=True))


def _newest_checkpoint(folder: Path) -> Path:
    found = [path for path in (folder / UNFINISHED, folder / CHECKPOINT) if path.is_file()]
    if not found:
        raise PocketGSError(f"{folder}: holds no {UNFINISHED} or {CHECKPOINT} to resume from")
    if len(found) == 2 and _goes_beyond(*found):
        return found[0]
    return max(found, key=lambda path: path.stat().st_mtime_ns)


def _goes_beyond(path: Path, other: Path) -> bool:
    """Whether a checkpoint is a later one of another's run. The files' times do not tell: many copies have new ones."""
    try:
        (run, iteration), (other_run, before) = map(_progress, (path, other))
    except Exception:  # a damaged archive fails in many ways, and again when it is read
        return False
    return run == other_run and iteration > before


def _progress(path: Path) -> tuple[str, int]:
    """What identifies a checkpoint's run, and its iteration."""
    with _arrays(path, "run", "iteration") as data:
        return str(data["run"]), int(data["iteration"])


class CheckpointSaver:
    """Writes a checkpoint at intervals, so that a long run can be resumed after a crash.

    If a checkpoint cannot be written, for example because the disk is full, the run continues.

    Args:
        folder: of the run.
        identity: what must be the same when the run is resumed.
        on_warning: called if a checkpoint cannot be written.
    """

    def __init__(self, folder: Path, identity: dict[str, Any], on_warning: Callable[[str], None]) -> None:
        self._folder, self._identity, self._on_warning = folder, identity, on_warning
        self._next = time.monotonic() + SECONDS_BETWEEN_CHECKPOINTS

    def observe(self, progress: Progress) -> None:
        """Write a checkpoint if the last one is old enough."""
        began = time.monotonic()
        if began < self._next:
            return
        try:
            path = self._folder / UNFINISHED
            write_checkpoint(path, progress.checkpoint(), self._identity)
        except (PocketGSError, OSError) as error:
            self._on_warning(f"training continues without a checkpoint: {error}")
        ended = time.monotonic()
        self._next = ended + max(SECONDS_BETWEEN_CHECKPOINTS, PAUSE * (ended - began))
