"""File names made from the names of photographs."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import PurePosixPath

MAX_NAME_LENGTH = 50


def plain_names(frames: Iterable[str]) -> list[str]:
    """Frames' names as plain file names without suffix, no two alike even where upper and lower case are the same."""
    names: list[str] = []
    taken: set[str] = set()
    for frame in frames:
        stem = re.sub(r"[^\w-]+", "_", str(PurePosixPath(frame).with_suffix(""))).strip("_")
        # File systems take names of 255 bytes, and a letter may need four; a name's end says most.
        stem = name = stem[-MAX_NAME_LENGTH:] or "frame"
        number = 1
        while name.casefold() in taken:
            number += 1
            name = f"{stem}_{number}"
        taken.add(name.casefold())
        names.append(name)
    return names
