"""The captures of the table, and where they come from."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from pocketgs.errors import PocketGSError

DATA_VARIABLE = "POCKETGS_DATA"


@dataclass(frozen=True)
class BenchCapture:
    """A capture to measure on.

    Attributes:
        name: as in tables and on the command line.
        path: of its folder.
        flags: of `pocketgs train` that say how to read it.
        what: it is, in words; empty for a user's own.
        origin: where to get it, in words; empty for a user's own.
    """

    name: str
    path: Path
    flags: tuple[str, ...] = ()
    what: str = ""
    origin: str = ""

    @property
    def is_there(self) -> bool:
        """Whether its folder exists, or will be made."""
        return self.name == DEMO or self.path.is_dir()


DEMO = "demo"

PUBLISHED = (
    BenchCapture(
        "fern",
        Path("fern"),
        ("--images", "images_8"),
        "LLFF: 20 stills of a phone, all facing one way; 504x378 before undistortion, every 8th held out",
        "nerf_llff_data, linked from https://github.com/Fyusion/LLFF and https://www.matthewtancik.com/nerf",
    ),
    BenchCapture(
        "lego",
        Path("lego"),
        ("--downscale", "2"),
        "NeRF-Synthetic: 100 views around a model, 400x400 on white, its own test views held out",
        "nerf_synthetic, linked from https://www.matthewtancik.com/nerf",
    ),
    BenchCapture(
        "fox",
        Path("fox"),
        ("--downscale", "4"),
        "instant-ngp: 50 hand-held frames of a phone, 270x480 before undistortion, every 8th held out",
        "data/nerf/fox in https://github.com/NVlabs/instant-ngp",
    ),
)


def data_folder(named: Path | None) -> Path:
    """The folder of all data: the one named, or the one that POCKETGS_DATA names, or `data`."""
    return named or Path(os.environ.get(DATA_VARIABLE, "data"))


def known_captures(data: Path, demo: Path) -> dict[str, BenchCapture]:
    """The captures of the table, by name.

    Args:
        data: folder that holds those that have been published.
        demo: folder of the built-in demo's capture, which is made when it is needed.
    """
    found = {
        capture.name: BenchCapture(capture.name, data / capture.path, capture.flags, capture.what, capture.origin)
        for capture in PUBLISHED
    }
    found[DEMO] = BenchCapture(
        DEMO, demo, (), "the built-in demo: 105 frames with a phone's faults, 480x360", "built in"
    )
    return found


def captures_named(
    names: tuple[str, ...], known: dict[str, BenchCapture], own_flags: tuple[str, ...] = ()
) -> list[BenchCapture]:
    """The captures of these names or folders; all known ones that are there if none is named.

    Args:
        names: names of known captures, or paths of a user's own.
        known: see `known_captures`.
        own_flags: of `pocketgs train` that say how to read a user's own captures.

    Raises:
        PocketGSError: one is neither known nor a folder, or is not there, or two of them have one name.
    """
    if not names:
        return [capture for capture in known.values() if capture.is_there]
    captures = []
    for name in names:
        capture = known.get(name) or BenchCapture(Path(name).resolve().name, Path(name), own_flags)
        if not capture.is_there:
            where = f"get it from {capture.origin}" if capture.origin else f"or one of {', '.join(known)}"
            raise PocketGSError(f"capture {name!r}: no folder {capture.path}, expected one; {where}")
        captures.append(capture)
    twice = {capture.name for capture in captures if [other.name for other in captures].count(capture.name) > 1}
    if twice:
        raise PocketGSError(f"capture {sorted(twice)[0]!r}: named twice, expected names that tell results apart")
    return captures
