"""What one run of a benchmark found, as it is kept on disk: a JSON file a cell of the table."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from pocketgs.atomic_file import replacing
from pocketgs.errors import PocketGSError

FORMAT = 1
"""Grows when older files can no longer be compared with newer ones."""


@dataclass(frozen=True, order=True)
class Cell:
    """One run of the table: a method on a capture with a seed."""

    capture: str
    method: str
    seed: int

    @property
    def name(self) -> str:
        """Its name in files and messages, for example `fern.pocketgs.0`."""
        return f"{self.capture}.{self.method}.{self.seed}"


@dataclass(frozen=True)
class CellResult:
    """What a cell found.

    Attributes:
        cell: which.
        command: that was run, as one types it; captures' folders are relative to that of all data.
        error: why it failed, in one line, or None. The fields below are empty then.
        wall_seconds: from the command's start to the written scene, looks at held-out views left out.
        scene_bytes: size of the scene by file format: "ply", "spz".
        run: the content of `run.json`; see `pocketgs.summary`.
        machine: what it ran on; see `pocketgs.bench.machine`.
    """

    cell: Cell
    command: str
    error: str | None = None
    wall_seconds: float = 0.0
    scene_bytes: dict[str, int] = field(default_factory=dict)
    run: dict[str, Any] = field(default_factory=dict)
    machine: dict[str, str] = field(default_factory=dict)


def write_result(folder: Path, result: CellResult) -> Path:
    """Write a result into the folder, in place of an earlier one of its cell.

    Raises:
        PocketGSError: it cannot be written.
    """
    path = folder / f"{result.cell.name}.json"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with replacing(path) as partial:
            partial.write_text(json.dumps({"format": FORMAT, **asdict(result)}, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise PocketGSError(f"{path}: cannot be written ({error.strerror or error})") from error
    return path


def read_result(path: Path) -> CellResult:
    """Read a result.

    Raises:
        PocketGSError: the file cannot be read, or is no result of this version.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise PocketGSError(f"{path}: cannot be read as a result ({error})") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise PocketGSError(f"{path}: expected a result of a benchmark, format {FORMAT}")
    try:
        cell = Cell(**document.pop("cell"))
        names = {entry.name for entry in fields(CellResult)} & document.keys()
        return CellResult(cell, **{name: document[name] for name in names})
    except TypeError as error:
        raise PocketGSError(f"{path}: not a result of a benchmark ({error})") from error


def read_results(folder: Path) -> list[CellResult]:
    """All results in a folder, sorted by capture, method and seed; an empty list if there is no such folder.

    Raises:
        PocketGSError: one of the files is no result.
    """
    return sorted((read_result(path) for path in folder.glob("*.json")), key=lambda result: result.cell)
