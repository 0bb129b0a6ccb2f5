"""Sort-free scenes as files, by their suffix: `.ply` is lossless, `.pgs` small."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from pocketgs.errors import PocketGSError
from pocketgs.scene.formats.pgs_sections import WEIGHTS, section_names
from pocketgs.scene.formats.spz_precision import Detail
from pocketgs.scene.gaussians import Gaussians
from pocketgs.sort_free import ply_file
from pocketgs.sort_free.scene import SortFreeScene


def write_sort_free(path: Path, scene: SortFreeScene, detail: Detail = "fine") -> None:
    """Write a scene atomically.

    Args:
        path: of the file.
        scene: to write.
        detail: how finely a `.pgs` rounds it.

    Raises:
        PocketGSError: the name is none for a sort-free scene, the scene holds numbers out of range, or the file cannot
            be written.
    """
    check_name(path)
    # The arrays may have changed since the scene was checked.
    scene = replace(scene)
    if not _is_pgs(path):
        ply_file.write_ply(path, scene)
        return
    # Imported here because Numba is slow to load.
    from pocketgs.sort_free.pgs_file import write_pgs

    write_pgs(path, scene, detail)


def check_name(path: Path) -> None:
    """Refuse a file name that is none for a sort-free scene.

    Raises:
        PocketGSError: it ends neither in .ply nor in .pgs, or in .compressed.ply.
    """
    if not _may_be(path):
        expected = "one that ends in .ply or .pgs: other formats hold no weights"
        raise PocketGSError(f"{path}: not a name for a sort-free scene, expected {expected}")


def check_storable(path: Path, gaussians: Gaussians) -> None:
    """Refuse Gaussians that a file of this name cannot hold, before they are trained.

    Raises:
        PocketGSError: a `.pgs` cannot hold as many, or as distant ones.
    """
    if _is_pgs(path):
        from pocketgs.scene.formats.pgs import require_storable

        require_storable(path, gaussians)


def is_sort_free(path: Path) -> bool:
    """Whether a file is a sort-free scene."""
    if not (_may_be(path) and path.is_file()):
        return False
    return WEIGHTS in section_names(path) if _is_pgs(path) else ply_file.is_marked(path)


def read_sort_free(path: Path) -> SortFreeScene:
    """Read a scene.

    Raises:
        PocketGSError: the file is missing or broken, or is no sort-free scene.
    """
    if not _is_pgs(path):
        return ply_file.read_ply(path)
    from pocketgs.sort_free.pgs_file import read_pgs

    return read_pgs(path)


def _may_be(path: Path) -> bool:
    name = path.name.lower()
    return name.endswith((".ply", ".pgs")) and not name.endswith(".compressed.ply")


def _is_pgs(path: Path) -> bool:
    return path.suffix.lower() == ".pgs"
