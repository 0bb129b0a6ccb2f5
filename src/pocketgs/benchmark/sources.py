"""Digest of the source code that a result comes from: the version number may stay the same while code changes."""

from __future__ import annotations

import hashlib
from pathlib import Path

PACKAGE = Path(__file__).parents[1]

ELSEWHERE = ("benchmark", "cli", "serve", "site", "torch", "viewer")
"""Folders of the package that do not affect what a run computes."""


def digest_of_sources(package: Path = PACKAGE) -> str:
    """Sixteen hexadecimal digits that change with any module or shader that affects results.

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
