"""Names in zip files."""

from __future__ import annotations

import re

_HERE = re.compile(r"(\./)+(?=[^/])")


def without_here(name: str) -> str:
    """A name without the `./` that some programs begin all names with, such as bsdtar."""
    here = _HERE.match(name)
    return name[here.end() :] if here else name
