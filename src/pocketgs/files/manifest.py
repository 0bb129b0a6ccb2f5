"""The list of files that commands wrote to a folder. Commands replace and delete only these."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path, PurePosixPath

from pocketgs.errors import PocketGSError

PRIVATE = ".pocketgs"
"""The commands' own folder inside an output folder: manifest, lock and unfinished results."""

MANIFEST = f"{PRIVATE}/manifest.json"


@dataclass(frozen=True)
class Manifest:
    """The files that commands wrote to a folder.

    Attributes:
        files: SHA-256 of each file's content, by its path in the folder with forward slashes.
        source: identifies the capture of the last run, see `source_of`; None if unknown.
    """

    files: dict[str, str] = field(default_factory=dict)
    source: str | None = None

    def encoded(self) -> str:
        """As JSON."""
        return json.dumps(asdict(self), indent=1, sort_keys=True) + "\n"

    def check_ours(self, folder: Path, names: Iterable[str]) -> None:
        """Refuse to replace files that no command wrote, or that have changed since.

        Args:
            folder: the folder of the manifest.
            names: paths in it; missing files are fine.

        Raises:
            PocketGSError: one of them was not written by a command, or has changed.
            OSError: one cannot be read.
        """
        for name in names:
            path = folder / name
            for above in (folder / part for part in PurePosixPath(name).parents):
                if above != folder and os.path.lexists(above) and (above.is_symlink() or not above.is_dir()):
                    raise PocketGSError(f"{above}: is not a folder that pocketgs made; {_ADVICE}")
            if not os.path.lexists(path):
                continue
            if name not in self.files or path.is_symlink() or not path.is_file():
                raise PocketGSError(f"{path}: was not written by pocketgs, and is not replaced; {_ADVICE}")
            if digest_of(path) != self.files[name]:
                raise PocketGSError(f"{path}: has been changed since pocketgs wrote it; {_ADVICE}")


_ADVICE = "move it away, or choose another output folder"


def read_manifest(folder: Path) -> Manifest:
    """Read the manifest of a folder; empty if it is missing or unreadable."""
    try:
        document = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        files = {str(name): str(digest) for name, digest in document["files"].items()}
        source = document["source"]
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return Manifest()
    inside = {name: digest for name, digest in files.items() if not _leads_out(PurePosixPath(name))}
    return Manifest(inside, source if isinstance(source, str) else None)


def _leads_out(path: PurePosixPath) -> bool:
    return path.is_absolute() or ".." in path.parts


def source_of(capture: Path) -> str:
    """Digest of a capture's path, which tells captures of the same name apart without revealing the path."""
    return hashlib.sha256(os.path.normcase(capture.resolve()).encode("utf-8", "surrogateescape")).hexdigest()[:16]


def digest_of(path: Path) -> str:
    """SHA-256 of a file's content, as hexadecimal digits."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(1 << 20):
            digest.update(piece)
    return digest.hexdigest()


def files_below(folder: Path) -> list[str]:
    """Paths of all files below a folder, relative to it, with forward slashes, sorted."""
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if not path.is_dir())
