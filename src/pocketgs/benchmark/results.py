"""Results of benchmark cells on disk: one JSON file per cell, command, capture and conditions."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pocketgs.benchmark.conditions import Conditions
from pocketgs.errors import PocketGSError
from pocketgs.files.atomic_file import replacing

FORMAT = 1
"""Increased when older files become incomparable."""


@dataclass(frozen=True, order=True)
class Cell:
    """One cell of the table: a method on a capture with a seed."""

    capture: str
    method: str
    seed: int

    @property
    def name(self) -> str:
        """Its name in files and messages, for example `fern.pocketgs.0`."""
        return f"{self.capture}.{self.method}.{self.seed}"


@dataclass(frozen=True)
class CellResult:
    """The result of a cell.

    Attributes:
        cell: the cell.
        command: as typed in the parent folder of the capture.
        error: reason of a failure, in one line, or None. The fields below are empty then.
        wall_seconds: from the command's start to the written scene, without evaluations on held-out views.
        scene_bytes: size of the scene by file format: "ply", "spz".
        run: the content of `run.json`; see `pocketgs.results.summary`.
        files: digest of the capture's files: another capture may have the same folder name.
        settings, sources, machine: the conditions; see `pocketgs.benchmark.conditions`.
    """

    cell: Cell
    command: str
    error: str | None = None
    wall_seconds: float = 0.0
    scene_bytes: dict[str, int] = field(default_factory=dict)
    run: dict[str, Any] = field(default_factory=dict)
    files: str = ""
    settings: str = ""
    sources: str = ""
    machine: dict[str, str] = field(default_factory=dict)

    @property
    def conditions(self) -> Conditions:
        """The conditions that results must share to be compared."""
        return Conditions(self.settings, self.sources, self.machine)

    def repeats(self, other: CellResult) -> bool:
        """Whether it is of the same cell as another, with the same command, capture and conditions."""
        mine, others = ((it.cell, it.command, it.files, it.conditions) for it in (self, other))
        return mine == others

    @property
    def digest(self) -> str:
        """Eight hexadecimal digits of command, capture and conditions, which tell results of one cell apart."""
        told = json.dumps([self.command, self.files, asdict(self.conditions)], sort_keys=True)
        return hashlib.sha256(told.encode()).hexdigest()[:8]


_KINDS: dict[str, type | tuple[type, ...]] = {
    "command": str,
    "error": (str, type(None)),
    "wall_seconds": (int, float),
    "scene_bytes": dict,
    "run": dict,
    "files": str,
    "settings": str,
    "sources": str,
    "machine": dict,
}
"""The type of each field of a result in the file, except its cell."""


def write_result(folder: Path, result: CellResult) -> Path:
    """Write a result to the folder, where it replaces an earlier one that it repeats.

    Successes stay: a failure does not replace one, and neither does a result of another command or capture or other
    conditions, which gets a file of its own.

    Returns:
        The file of the result, or of the success that it does not replace.

    Raises:
        PocketGSError: it cannot be written, or a file in the folder is not a result.
    """
    earlier = {path: read_result(path) for path in _files(folder)}
    path = next((path for path, found in earlier.items() if result.repeats(found)), None)
    if path is None:
        path = folder / f"{result.cell.name}.json"
        if path in earlier and earlier[path].error is None:
            path = folder / f"{result.cell.name}.{result.digest}.json"
    elif result.error is not None and earlier[path].error is None:
        return path
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
        PocketGSError: the file cannot be read, or is not a result of this version.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise PocketGSError(f"{path}: cannot be read as a result ({error})") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise PocketGSError(f"{path}: expected a result of a benchmark, format {FORMAT}")
    cell = document.get("cell")
    kinds = {"capture": str, "method": str, "seed": int}
    if not isinstance(cell, dict) or {name: type(value) for name, value in cell.items()} != kinds:
        raise PocketGSError(f"{path}: its cell is {cell!r}, expected a capture, a method and a whole number for seed")
    found = {name: document[name] for name in _KINDS if name in document}
    for name, value in found.items():
        if not isinstance(value, _KINDS[name]):
            raise PocketGSError(f"{path}: its {name} is {value!r}, expected the type of benchmark results")
    if "command" not in found:
        raise PocketGSError(f"{path}: no command, expected a result of a benchmark")
    return CellResult(Cell(**cell), **found)


def read_results(folder: Path) -> list[CellResult]:
    """Read all results in a folder, sorted by capture, method and seed; empty if there is no such folder.

    Hidden files are ignored: killed processes leave them half written.

    Raises:
        PocketGSError: a file is not a result.
    """
    return sorted(map(read_result, _files(folder)), key=lambda result: result.cell)


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.glob("*.json") if not path.name.startswith("."))
