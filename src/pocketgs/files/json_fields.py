"""Typed access to JSON, with errors that name the file, the field, what was found and what was expected."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pocketgs.errors import PocketGSError, clipped, short
from pocketgs.files.memory_bound import JSON_BYTES, require_memory
from pocketgs.files.opening import read_bytes


class DamagedJsonError(PocketGSError):
    """A file is no JSON, such as an empty one whose transfer was interrupted."""


@dataclass(frozen=True)
class Fields:
    """One JSON object.

    Attributes:
        values: the object as `json` parses it.
        where: the file and the position in it, for error messages.
    """

    values: dict[str, Any]
    where: str

    def number(self, name: str) -> float:
        """A finite number, or text that holds one. Raises PocketGSError if it is absent or of another type."""
        value = self._required(name, "a number")
        number = _number_in(value)
        if not _is_number(number):
            raise self._wrong(name, value, "a finite number")
        return float(number)

    def optional_number(self, name: str) -> float | None:
        """A finite number, or None if the field is absent or null."""
        return None if self.values.get(name) is None else self.number(name)

    def text(self, name: str) -> str:
        """A non-empty string. Raises PocketGSError if it is absent or of another type."""
        value = self._required(name, "text")
        if not isinstance(value, str) or not value:
            raise self._wrong(name, value, "text")
        return value

    def optional_text(self, name: str) -> str | None:
        """A string, or None if the field is absent or null."""
        return None if self.values.get(name) is None else self.text(name)

    def optional_texts(self, name: str) -> list[str] | None:
        """A list of strings, or None if the field is absent or null."""
        value = self.values.get(name)
        if value is None:
            return None
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise self._wrong(name, value, "a list of strings")
        return value

    def flag(self, name: str) -> bool:
        """A boolean; False if the field is absent or null."""
        value = self.values.get(name)
        if value is not None and not isinstance(value, bool):
            raise self._wrong(name, value, "true or false")
        return bool(value)

    def numbers(self, name: str, count: int) -> np.ndarray:
        """(count,) float64 of finite numbers. Raises PocketGSError if it is absent or of another type."""
        value = self._required(name, f"{count} numbers")
        if not isinstance(value, list) or len(value) != count or not all(map(_is_number, value)):
            raise self._wrong(name, value, f"{count} finite numbers")
        return np.array(value, dtype=np.float64)

    def matrix(self, name: str, columns: int) -> np.ndarray:
        """(rows, columns) float64 of finite numbers. Raises PocketGSError if it is absent or of another type."""
        value = self._required(name, f"rows of {columns} numbers")
        is_matrix = isinstance(value, list) and all(
            isinstance(row, list) and len(row) == columns and all(map(_is_number, row)) for row in value
        )
        if not is_matrix or not value:
            raise self._wrong(name, value, f"rows of {columns} finite numbers")
        return np.array(value, dtype=np.float64)

    def objects(self, name: str) -> list[Fields]:
        """A list of JSON objects. Raises PocketGSError if it is absent or of another type."""
        value = self._required(name, "a list of objects")
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            raise self._wrong(name, value, "a list of objects")
        return [Fields(item, f"{self.where}, {name}[{index}]") for index, item in enumerate(value)]

    def over(self, defaults: Fields) -> Fields:
        """These fields, with missing ones filled in from `defaults`."""
        return Fields({**defaults.values, **self.values}, self.where)

    def _required(self, name: str, expected: str) -> Any:
        if name not in self.values:
            raise PocketGSError(f"{self.where}: no field '{name}', expected {expected}")
        return self.values[name]

    def _wrong(self, name: str, found: Any, expected: str) -> PocketGSError:
        return PocketGSError(f"{self.where}: field '{name}' is {short(found)}, expected {expected}")


def read_json(path: Path) -> Fields:
    """Read a JSON file that holds an object.

    Raises:
        DamagedJsonError: the file is not UTF-8 or not JSON.
        PocketGSError: it cannot be read, or does not hold an object.
    """
    try:
        content = read_bytes(path)
    except OSError as error:
        raise PocketGSError(f"{path}: cannot be read ({error.strerror})") from error
    return parse_json(content, str(path))


def parse_json(content: bytes, where: str) -> Fields:
    """Parse the content of a JSON file that holds an object.

    Args:
        content: the bytes of the file.
        where: the file, for error messages.

    Raises:
        DamagedJsonError: the content is not UTF-8 or not JSON.
        PocketGSError: it is not an object, or would take too much memory.
    """
    require_memory(where, JSON_BYTES * len(content), f"JSON of {len(content):,} bytes")
    try:
        value = json.loads(content.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise DamagedJsonError(f"{where}: not valid JSON in UTF-8 ({clipped(error)})") from error
    if not isinstance(value, dict):
        raise PocketGSError(f"{where}: holds a JSON {type(value).__name__}, expected an object")
    return Fields(value, where)


def _number_in(value: Any) -> Any:
    """The number that a text holds, as nerfstudio writes RealityCapture's lenses; any other value as it is."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    try:
        return bool(np.isfinite(float(value)))
    except OverflowError:
        return False
