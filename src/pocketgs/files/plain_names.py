"""File names made from the names of photographs."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import PurePosixPath

MAX_NAME_LENGTH = 50


def plain_names(frames: Iterable[str]) -> list[str]:
    """Plain, unique file names without suffix for frames, also where the file system ignores case."""
    names: list[str] = []
    taken: set[str] = set()
    for frame in frames:
        stem = re.sub(r"[^\w-]+", "_", str(PurePosixPath(frame).with_suffix(""))).strip("_")
        # File systems allow 255 bytes, and a character may take four. The end of a name says most.
        stem = name = stem[-MAX_NAME_LENGTH:] or "frame"
        number = 1
        while name.casefold() in taken:
            number += 1
            name = f"{stem}_{number}"
        taken.add(name.casefold())
        names.append(name)
    return names
