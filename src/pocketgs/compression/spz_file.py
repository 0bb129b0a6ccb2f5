"""A scene as a `.spz` holds it, for comparison."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from pocketgs.errors import PocketGSError
from pocketgs.scene.edits import scaled
from pocketgs.scene.formats.spz import is_visibly_cut, read_gaussians, rounded, write_gaussians
from pocketgs.scene.formats.spz_attributes import fractional_bits_for
from pocketgs.scene.formats.spz_precision import SMALL
from pocketgs.scene.formats.spz_range import suitable_factor
from pocketgs.scene.gaussians import Gaussians
from pocketgs.scene.warning import SceneWarning

WRITING_SECONDS = 5e-5
"""Approximate time per Gaussian that `as_spz` takes, of degree 3 on one core; 33 s were measured for 672,870."""


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


def rounded_as_spz(scene: Gaussians) -> Gaussians:
    """The scene with the precision of a .spz; the order changes.

    That is in the scene's own unit of length, as in `as_spz`, or where it would show, in one that suits the format.

    Args:
        scene: finite.

    Raises:
        PocketGSError: its sizes or distances differ by more than the format can hold without showing it.
    """
    # A unit that suits the median Gaussian may cut large ones of the background, which show even if they are few.
    for factor in (1.0, suitable_factor(scene)):
        suited = scaled(scene, factor)
        if not is_visibly_cut(suited, SMALL):
            return scaled(rounded(suited, SMALL), 1.0 / factor)
    raise PocketGSError("scene: its sizes, or its distances and sizes, differ by more than a .spz can hold")
