"""Running one cell of the benchmark: a `pocketgs train` command in a process of its own."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from pocketgs.benchmark.captures import BenchCapture
from pocketgs.benchmark.conditions import present_conditions
from pocketgs.benchmark.methods import Method
from pocketgs.benchmark.results import Cell, CellResult
from pocketgs.errors import PocketGSError
from pocketgs.results import folder as result_folder
from pocketgs.scene.formats import read_scene, spz
from pocketgs.scene.formats.spz_precision import SMALL

GRACE = 15.0
"""Seconds that an interrupted command has to end its own child processes, such as COLMAP."""


@dataclass(frozen=True)
class Job:
    """A cell to run.

    Attributes:
        method, capture, seed: of the cell.
        common_flags: of `pocketgs train`, common to all cells.
    """

    method: Method
    capture: BenchCapture
    seed: int
    common_flags: tuple[str, ...] = ()

    @property
    def cell(self) -> Cell:
        """The cell in the table."""
        return Cell(self.capture.name, self.method.name, self.seed)

    @property
    def flags(self) -> list[str]:
        """All flags of `pocketgs train` except the output."""
        return [*self.capture.flags, *self.method.flags, *self.common_flags, "--seed", str(self.seed)]

    @property
    def command(self) -> str:
        """The command line, as typed in the parent folder of the capture."""
        return shlex.join(["pocketgs", "train", self.capture.folder_name, *self.flags])


def run_cell(job: Job, work: Path) -> CellResult:
    """Run a cell.

    A process of its own isolates failures, and makes time and peak memory those of the command.

    Args:
        job: what to run.
        work: folder for the run's files: a folder and a log with the cell's name.

    Returns:
        The result; if the command failed, it contains the error.

    Raises:
        KeyboardInterrupt: Ctrl-C; the command has been stopped.
        OSError: the folder cannot be written to.
    """
    folder, log = work / job.cell.name, work / f"{job.cell.name}.log"
    work.mkdir(parents=True, exist_ok=True)
    # A relative path such as "." also stands for other things where the result is searched for it.
    capture = Path(os.path.abspath(job.capture.path))
    command = [sys.executable, "-m", "pocketgs", "train", str(capture), *job.flags, "--output", str(folder)]
    begun = CellResult(job.cell, job.command, files=job.capture.files, **asdict(present_conditions(job.common_flags)))
    status = _run(command, log)
    if status != 0:
        return replace(begun, error=_last_words(log, status))
    try:
        return _collected(begun, folder, capture)
    except (PocketGSError, OSError, ValueError) as error:
        return replace(begun, error=str(error))


def _run(command: Sequence[str], log: Path) -> int:
    with log.open("w", encoding="utf-8") as output, subprocess.Popen(command, stdout=output, stderr=output) as process:
        try:
            return process.wait()
        except BaseException:
            _end(process)
            raise


def _end(process: subprocess.Popen[bytes]) -> None:
    """Ask a process to stop, so that it ends its own processes too, and kill it if it does not.

    The command handles SIGTERM like Ctrl-C, and receives it even where Ctrl-C is ignored, as under `nohup`.
    """
    try:
        process.terminate()
        with suppress(subprocess.TimeoutExpired):
            process.wait(GRACE)
    finally:
        process.kill()
        process.wait()


def _last_words(log: Path, status: int) -> str:
    """The last line of a log; and the status if the process was killed or printed nothing."""
    lines = [line.strip() for line in log.read_text(encoding="utf-8", errors="replace").splitlines() if line.strip()]
    ended = f"ended with status {status}".replace("-", "−")
    if not lines:
        return f"{ended} and no output"
    return f"{ended}: {lines[-1]}" if status < 0 else lines[-1]


def _named_alone(record: str, capture: Path) -> str:
    """A record in JSON with the capture's name in place of its path, except where that is part of another name."""
    path = re.escape(json.dumps(str(capture))[1:-1])
    return re.sub(rf"(?<![\w.-]){path}(?![\w.-])", lambda _: json.dumps(capture.name)[1:-1], record)


def _collected(begun: CellResult, folder: Path, capture: Path) -> CellResult:
    """Add the files that the command wrote to the result; the capture's path is removed."""
    told = (folder / result_folder.RECORD).read_text(encoding="utf-8")
    run: dict[str, Any] = json.loads(_named_alone(told, capture))
    if run["interrupted"]:
        raise PocketGSError("the run was interrupted")
    if run["psnr"] is None:
        raise PocketGSError("the capture has no held-out view to measure on")
    if run["prior"]:
        del run["prior"]["decisions"]  # one line per frame, the same in every cell
    scene = folder / result_folder.SCENE
    compressed = scene.with_suffix(".spz")
    spz.write_gaussians(compressed, read_scene(scene), precision=SMALL)  # as `pocketgs convert` does
    return replace(
        begun,
        wall_seconds=round(run["seconds"]["total"] - run["seconds"]["evaluation"], 3),
        scene_bytes={"ply": scene.stat().st_size, "spz": compressed.stat().st_size},
        run=run,
    )
