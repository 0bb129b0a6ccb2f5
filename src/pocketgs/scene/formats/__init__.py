"""Scene file formats, one module per format, chosen by file name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pocketgs.errors import PocketGSError
from pocketgs.files.journal import settle
from pocketgs.scene.formats import compressed_ply, gltf, ply, splat, spz
from pocketgs.scene.formats.pgs_coding import FINE as FINE_PGS
from pocketgs.scene.formats.pgs_coding import Coding
from pocketgs.scene.formats.spz_precision import FINE
from pocketgs.scene.gaussians import Gaussians


@dataclass(frozen=True)
class SceneFormat:
    """A file format of scenes.

    Attributes:
        name: of the format.
        suffixes: of its files.
        drops: what the format cannot hold; empty if nothing.
        rounds: the largest rounding errors of the rest; empty if it is lossless.
        read: reads a scene from a file.
        write: writes a scene to a file, atomically.
    """

    name: str
    suffixes: tuple[str, ...]
    drops: str
    rounds: str
    read: Callable[[Path], Gaussians]
    write: Callable[[Path, Gaussians], None]


# Numba and Pillow are slow to load: the next four functions import them.


def _read_pgs(path: Path) -> Gaussians:
    from pocketgs.scene.formats import pgs

    return pgs.read_gaussians(path)


def write_pgs(path: Path, gaussians: Gaussians, coding: Coding = FINE_PGS) -> None:
    """Write a `.pgs`; as `pgs.write_gaussians`, but fine unless told otherwise."""
    from pocketgs.scene.formats import pgs

    pgs.write_gaussians(path, gaussians, coding)


def _read_sog(path: Path) -> Gaussians:
    from pocketgs.scene.formats import sog

    return sog.read_gaussians(path)


def _write_sog(path: Path, gaussians: Gaussians) -> None:
    from pocketgs.scene.formats import sog

    sog.write_gaussians(path, gaussians)


# A suffix that ends in another one comes first.
FORMATS = (
    SceneFormat(
        "PlayCanvas compressed PLY",
        (".compressed.ply",),
        "the order of Gaussians",
        "centres and log scales to 1/4000 (y: 1/2000) and colours to 1/500 of their range in 256 neighbours, opacity "
        "to 1/500, rotation to 0.3 degrees, spherical harmonics to 1/64 within -4 to 4",
        compressed_ply.read_gaussians,
        compressed_ply.write_gaussians,
    ),
    SceneFormat("3DGS PLY", (".ply",), "", "", ply.read_gaussians, ply.write_gaussians),
    SceneFormat(
        "Niantic SPZ",
        (".spz",),
        FINE.drops,
        FINE.rounds,
        spz.read_gaussians,
        spz.write_gaussians,
    ),
    SceneFormat(
        "PocketGS",
        (".pgs",),
        "the order of Gaussians or of their axes",
        FINE_PGS.rounds,
        _read_pgs,
        write_pgs,
    ),
    SceneFormat(
        "PlayCanvas SOG",
        (".sog",),
        "the order of Gaussians",
        "centres to 1/130,000 of their range, log scales and colours to 256 values, rotation to 1 degree, opacity to "
        "1/500, spherical harmonics to 4096 vectors of 256 values",
        _read_sog,
        _write_sog,
    ),
    SceneFormat(
        "antimatter15 splat",
        (".splat",),
        "the order of Gaussians, or spherical harmonics above degree 0",
        "opacity to 1/500, colours to 1/500 within 0 to 1, rotation to 1 degree",
        splat.read_gaussians,
        splat.write_gaussians,
    ),
    SceneFormat(
        "glTF with KHR_gaussian_splatting",
        (".glb", ".gltf"),
        "the lengths of quaternions",
        "opacity to 1e-7",
        gltf.read_gaussians,
        gltf.write_gaussians,
    ),
)


def is_scene_name(path: Path) -> bool:
    """Whether a path has the suffix of a scene format."""
    return any(path.name.lower().endswith(each.suffixes) for each in FORMATS)


def format_of(path: Path) -> SceneFormat:
    """The format that a path's suffix names.

    Raises:
        PocketGSError: it names none.
    """
    for each in FORMATS:
        if path.name.lower().endswith(each.suffixes):
            return each
    known = ", ".join(suffix for each in FORMATS for suffix in each.suffixes)
    raise PocketGSError(f"{path}: not the name of a scene file, expected one that ends in {known}")


def read_scene(path: Path) -> Gaussians:
    """Read a scene in any format; a `.ply` may be compressed.

    Raises:
        PocketGSError: the suffix is unknown, or the file is missing or broken.
    """
    read = format_of(path).read
    settle(path.parent)
    if read is ply.read_gaussians and compressed_ply.recognises(path):
        read = compressed_ply.read_gaussians
    return read(path)


def write_scene(path: Path, gaussians: Gaussians) -> None:
    """Write a scene atomically in the format that the suffix names.

    Raises:
        PocketGSError: the suffix is unknown, the format cannot hold the scene, or the file cannot be written.
    """
    format_of(path).write(path, gaussians)
