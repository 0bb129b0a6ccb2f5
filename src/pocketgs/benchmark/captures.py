"""The captures of the benchmark, and their sources."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from pocketgs.errors import PocketGSError

DATA_VARIABLE = "POCKETGS_DATA"


@dataclass(frozen=True)
class BenchCapture:
    """A capture of the benchmark.

    Attributes:
        name: as in tables and on the command line.
        path: its folder.
        flags: of `pocketgs train`, for reading it.
        what: description; empty for a user's own.
        origin: where to get it; empty for a user's own.
        written: folders that the benchmark writes, which are no part of it where they lie inside its folder.
    """

    name: str
    path: Path
    flags: tuple[str, ...] = ()
    what: str = ""
    origin: str = ""
    written: tuple[Path, ...] = ()

    @property
    def folder_name(self) -> str:
        """Name of its folder, with which a command reads it from the parent folder."""
        return os.path.basename(os.path.abspath(self.path))

    @property
    def is_there(self) -> bool:
        """Whether its folder exists, or will be made."""
        return self.name == DEMO or self.path.is_dir()

    @cached_property
    def files(self) -> str:
        """Sixteen hexadecimal digits of the names and sizes of its files; empty for the demo, which the code makes."""
        if self.name == DEMO:
            return ""
        digest = hashlib.sha256()
        for path in sorted(self.path.rglob("*")):
            place = path.relative_to(self.path)
            is_hidden = any(part.startswith(".") for part in place.parts)
            if path.is_file() and not is_hidden and self._written_inside.isdisjoint(place.parents):
                digest.update(f"{place.as_posix()}\0{path.stat().st_size}\0".encode())
        return digest.hexdigest()[:16]

    @cached_property
    def _written_inside(self) -> set[Path]:
        """The folders inside its own that the benchmark writes, relative to it."""
        root = self.path.resolve()
        written = (folder.resolve() for folder in self.written)
        return {folder.relative_to(root) for folder in written if root in folder.parents}


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
    """The folder of all data: `named`, or the one that POCKETGS_DATA names, or `data`."""
    return named or Path(os.environ.get(DATA_VARIABLE, "data"))


def known_captures(data: Path, demo: Path) -> dict[str, BenchCapture]:
    """The captures of the benchmark by name.

    Args:
        data: folder of the published captures.
        demo: folder of the built-in demo's capture, which is made when needed.
    """
    found = {
        capture.name: BenchCapture(capture.name, data / capture.path, capture.flags, capture.what, capture.origin)
        for capture in PUBLISHED
    }
    found[DEMO] = BenchCapture(
        DEMO, demo, (), "the built-in demo: 120 frames with a phone's faults, 480x360, every 8th held out", "built in"
    )
    return found


def captures_named(
    names: tuple[str, ...], known: dict[str, BenchCapture], own_flags: tuple[str, ...] = ()
) -> list[BenchCapture]:
    """The captures with these names or folders; all available known ones if none is named.

    Args:
        names: names of known captures, or paths of a user's own.
        known: see `known_captures`.
        own_flags: of `pocketgs train`, for reading a user's own captures.

    Raises:
        PocketGSError: one is neither known nor a folder, is missing or hidden, or has the name of another; or flags are
            given and all captures are known ones.
    """
    chosen = [_named(name, known, own_flags) for name in names] or [it for it in known.values() if it.is_there]
    twice = {capture.name for capture in chosen if [other.name for other in chosen].count(capture.name) > 1}
    if twice:
        raise PocketGSError(f"capture {sorted(twice)[0]!r}: named twice, expected names that tell results apart")
    hidden = [capture.name for capture in chosen if capture.name.startswith(".")]
    if hidden:
        raise PocketGSError(f"capture {hidden[0]!r}: its name begins with a dot, as hidden files do: rename its folder")
    if own_flags and all(capture in known.values() for capture in chosen):
        expected = "expected a folder of your own: known captures are read as published results read them"
        raise PocketGSError(f"{' '.join(own_flags)}: not for {', '.join(it.name for it in chosen)}, {expected}")
    return chosen


def _named(name: str, known: dict[str, BenchCapture], own_flags: tuple[str, ...]) -> BenchCapture:
    """The known capture of this name, or the user's own in this folder."""
    own = BenchCapture(Path(name).resolve().name, Path(name), own_flags)
    capture = known.get(name, own)
    if not capture.is_there:
        where = f"get it from {capture.origin}" if capture.origin else f"or one of {', '.join(known)}"
        raise PocketGSError(f"capture {name!r}: no folder {capture.path}, expected one; {where}")
    if capture is own and own.name in known:
        expected = f"expected another name, or {own.name} for the one in {known[own.name].path}"
        raise PocketGSError(f"capture {name!r}: has the name of a known capture, {expected}")
    return capture
