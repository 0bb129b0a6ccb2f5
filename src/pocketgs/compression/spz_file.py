"""A scene as stored in a `.spz`, for comparison."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from pocketgs.scene.formats.spz import read_gaussians, write_gaussians
from pocketgs.scene.formats.spz_attributes import fractional_bits_for
from pocketgs.scene.formats.spz_precision import SMALL
from pocketgs.scene.gaussians import Gaussians
from pocketgs.scene.warning import SceneWarning


@dataclass(frozen=True)
class SpzFile:
    """A scene in a .spz, with the size of the file in bytes."""

    scene: Gaussians
    bytes: int


def as_spz(scene: Gaussians) -> SpzFile | None:
    """The scene that `convert` would store by default; it must be finite. None if its coordinates are too large."""
    if fractional_bits_for(scene, SMALL) is None:
        return None
    with TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)  # of a file that nobody asked for
        path = Path(folder) / "scene.spz"
        write_gaussians(path, scene, precision=SMALL)
        return SpzFile(read_gaussians(path), path.stat().st_size)
