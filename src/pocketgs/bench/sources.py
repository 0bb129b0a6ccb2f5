"""Which code a result comes from: a version number stays the same while code changes."""

from __future__ import annotations

import hashlib
from pathlib import Path

PACKAGE = Path(__file__).parents[1]

ELSEWHERE = ("bench", "cli", "viewer")
"""Folders of the package that measure, ask and show: what a run computes does not depend on them."""


def digest_of_sources(package: Path = PACKAGE) -> str:
    """Sixteen hexadecimal digits that change when a module or a shader that runs compute with does.

    Args:
        package: folder of the package's sources.
    """
    digest = hashlib.sha256()
    for path in sorted((*package.rglob("*.py"), *package.rglob("*.wgsl"))):
        place = path.relative_to(package)
        if place.parts[0] not in ELSEWHERE:
            digest.update(f"{place.as_posix()}\0".encode())
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:16]
