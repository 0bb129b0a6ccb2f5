"""What commands have written into a folder: only that may they replace or delete later."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path, PurePosixPath

from pocketgs.errors import PocketGSError

PRIVATE = ".pocketgs"
"""The folder inside an output folder that is the commands' own: the manifest, the lock, and what is half done."""

MANIFEST = f"{PRIVATE}/manifest.json"


@dataclass(frozen=True)
class Manifest:
    """What has been written into a folder.

    Attributes:
        files: SHA-256 of each file's content, by its path in the folder with forward slashes.
        source: what tells the capture of the last run from others, see `source_of`; None if it is not known.
    """

    files: dict[str, str] = field(default_factory=dict)
    source: str | None = None

    def encoded(self) -> str:
        """As JSON."""
        return json.dumps(asdict(self), indent=1, sort_keys=True) + "\n"

    def check_ours(self, folder: Path, names: Iterable[str]) -> None:
        """Refuse to replace what no command has written, or what has been changed since.

        Args:
            folder: that the manifest is of.
            names: paths in it; those that do not exist are no obstacle.

        Raises:
            PocketGSError: one of them is somebody else's.
            OSError: one cannot be read.
        """
        for name in names:
            path = folder / name
            for above in (folder / part for part in PurePosixPath(name).parents):
                if above != folder and os.path.lexists(above) and (above.is_symlink() or not above.is_dir()):
                    raise PocketGSError(f"{above}: is no folder that pocketgs has made; {_ADVICE}")
            if not os.path.lexists(path):
                continue
            if name not in self.files or path.is_symlink() or not path.is_file():
                raise PocketGSError(f"{path}: was not written by pocketgs, and is not replaced; {_ADVICE}")
            if digest_of(path) != self.files[name]:
                raise PocketGSError(f"{path}: has been changed since pocketgs wrote it; {_ADVICE}")


_ADVICE = "expected it moved away, or another output folder"


def read_manifest(folder: Path) -> Manifest:
    """The manifest of a folder; an empty one where there is none, or one that cannot be read."""
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
    """What tells captures of one name apart: a digest of where they lie, which says nothing of the place itself."""
    return hashlib.sha256(os.path.normcase(capture.resolve()).encode("utf-8", "surrogateescape")).hexdigest()[:16]


def digest_of(path: Path) -> str:
    """SHA-256 of a file's content, as hexadecimal digits."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(1 << 20):
            digest.update(piece)
    return digest.hexdigest()


def files_below(folder: Path) -> list[str]:
    """The paths of all files below a folder, relative to it, with forward slashes, sorted."""
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if not path.is_dir())
