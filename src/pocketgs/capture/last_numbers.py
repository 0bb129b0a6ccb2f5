"""Pairing files with photographs by the last numbers in their names."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path, PureWindowsPath

NUMBERLESS, MAX_DIGITS = -1, 18


def last_number(stem: str) -> int:
    """The last number in a file name without suffix, or `NUMBERLESS`."""
    digits = re.findall(r"\d+", stem)
    return int(digits[-1][-MAX_DIGITS:]) if digits else NUMBERLESS


def pair_by_number(photographs: Sequence[str], files: Sequence[Path]) -> dict[str, Path]:
    """The file of each photograph by the last number in its name.

    Args:
        photographs: their paths, with either separator.
        files: such as their masks, or copies that were renamed.

    Returns:
        Files by photograph; empty unless both have the same numbers, each once.
    """
    numbers = {name: last_number(PureWindowsPath(name).stem) for name in photographs}
    by_number = {last_number(file.stem): file for file in files}
    agree = sorted(numbers.values()) == sorted(last_number(file.stem) for file in files)
    if not agree or NUMBERLESS in by_number or len(by_number) < len(files):
        return {}
    return {name: by_number[number] for name, number in numbers.items()}
