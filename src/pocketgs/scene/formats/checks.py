"""What every format that stores Gaussians in fewer bits asks of a file and of a scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import require_memory
from pocketgs.files.opening import read_bytes
from pocketgs.scene.gaussians import Gaussians


def read_contents(path: Path) -> bytes:
    """The bytes of a scene file.

    Raises:
        PocketGSError: there is no such file, it cannot be read, or memory would not hold it.
    """
    try:
        if not path.is_file():
            raise PocketGSError(f"{path}: no such file, expected a scene")
        return read_bytes(path)
    except OSError as error:
        raise PocketGSError(f"{path}: cannot be read ({error.strerror or error})") from error


def require_room(path: Path, count: int, coefficients: int, reading: tuple[int, int]) -> None:
    """Refuse a scene before it is unpacked that memory would not hold.

    Args:
        path: the file.
        count: of Gaussians that it states.
        coefficients: of spherical harmonics a channel.
        reading: bytes that a format's reader takes at most for a Gaussian, and for a coefficient of each.

    Raises:
        PocketGSError: it would take more than there may be.
    """
    base, each = reading
    require_memory(path, count * (base + each * coefficients), f"{count:,} Gaussians")


def require_sound(path: Path, gaussians: Gaussians) -> None:
    """Refuse a scene without Gaussians, or with numbers that stand for nothing.

    An infinite opacity logit stands for an opacity of exactly 0 or 1, and some programs write it.

    Raises:
        PocketGSError: the scene is empty, or a Gaussian holds NaN or infinity.
    """
    if len(gaussians) == 0:
        raise PocketGSError(f"{path}: 0 Gaussians, expected at least one")
    sound = np.isfinite(gaussians.means).all(axis=1)
    sound &= np.isfinite(gaussians.log_scales).all(axis=1)
    sound &= np.isfinite(gaussians.quaternions).all(axis=1)
    sound &= np.isfinite(gaussians.sh).all(axis=(1, 2))
    sound &= ~np.isnan(gaussians.opacity_logits)
    broken = len(sound) - int(np.count_nonzero(sound))
    if broken:
        raise PocketGSError(f"{path}: {broken} of {len(sound)} Gaussians hold NaN or infinity, expected finite numbers")
