"""Checks of files and scenes that all quantising formats share."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import require_memory
from pocketgs.files.opening import read_bytes
from pocketgs.scene.gaussians import Gaussians
from pocketgs.scene.warning import warn


def read_contents(path: Path) -> bytes:
    """Read a scene file.

    Raises:
        PocketGSError: it does not exist, cannot be read, or exceeds the memory bound.
    """
    try:
        if not path.is_file():
            raise PocketGSError(f"{path}: no such file, expected a scene")
        return read_bytes(path)
    except OSError as error:
        raise PocketGSError(f"{path}: cannot be read ({error.strerror or error})") from error


def require_room(path: Path, count: int, coefficients: int, reading: tuple[int, int]) -> None:
    """Check the memory that a scene needs before it is unpacked.

    Args:
        path: the file.
        count: number of Gaussians that the file states.
        coefficients: of spherical harmonics per channel.
        reading: maximum bytes that the format's reader takes per Gaussian, and per coefficient of each Gaussian.

    Raises:
        PocketGSError: it exceeds the memory bound.
    """
    base, each = reading
    require_memory(path, count * (base + each * coefficients), f"{count:,} Gaussians")


def require_any(path: Path, count: int) -> None:
    """Refuse a scene without Gaussians.

    Raises:
        PocketGSError: `count` is 0.
    """
    if count == 0:
        raise PocketGSError(f"{path}: 0 Gaussians, expected at least one")


def warn_of_degree_4(path: Path) -> None:
    """Warn that a file's spherical harmonics of degree 4 are dropped."""
    warn(f"{path}: spherical harmonics of degree 4, which are dropped: the highest degree here is 3")


def require_sound(path: Path, gaussians: Gaussians) -> None:
    """Refuse an empty scene, and NaN or infinity.

    An infinite opacity logit is allowed: it means an opacity of exactly 0 or 1, and some programs write it.

    Raises:
        PocketGSError: the scene is empty, or a Gaussian holds NaN or infinity.
    """
    require_any(path, len(gaussians))
    if broken := int(np.count_nonzero(~gaussians.is_finite)):
        raise PocketGSError(
            f"{path}: {broken} of {len(gaussians)} Gaussians hold NaN or infinity, expected finite numbers"
        )
