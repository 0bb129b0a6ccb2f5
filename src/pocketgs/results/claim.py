"""Exclusive use of an output folder by one command."""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from pocketgs.capture.open import holds_capture
from pocketgs.capture.unposed import USUAL_FOLDER, find_photographs_in
from pocketgs.errors import PocketGSError
from pocketgs.files.journal import KEPT, LOCK, NEW, complete_pending, new_staging, publish, remove_staging
from pocketgs.files.lock import locked
from pocketgs.files.manifest import MANIFEST, PRIVATE, Manifest, digest_of, files_below, read_manifest


@dataclass(frozen=True)
class Claim:
    """An output folder that this process has locked.

    Attributes:
        folder: the folder.
        source: identifies the capture of a run, see `source_of`; None for other commands.
    """

    folder: Path
    source: str | None = None

    @contextmanager
    def publishing(
        self, expected: Iterable[str] = (), outdated: Sequence[str] = (), precious: str | None = None
    ) -> Iterator[Path]:
        """Yield an empty folder to write to; when the block succeeds, publish its content to the claimed folder as one.

        Args:
            expected: files that the block must have written.
            outdated: patterns of files of earlier runs to delete unless the block writes them anew. They match the end
                of a path in the folder, or all of it if they begin with /.
            precious: a file that took long to make. If the block fails after writing it, what is written by then is
                kept in a folder `unpublished-*`, which the message names.

        Raises:
            PocketGSError: the folder cannot be written to, a file that the block wrote is missing, or another program's
                file is in the way; in the last case a complete result is kept elsewhere. Also any error of the block
                after which something was kept.
            KeyboardInterrupt: Ctrl-C; its message says what was kept.
        """
        staging = None
        try:
            staging = new_staging(self.folder)
            yield staging / NEW
            self._publish(staging, expected, outdated)
        except BaseException as error:
            kept = _kept(self.folder, staging, precious) if staging and precious else None
            where = f"; {precious} is kept in {kept}" if kept else ""
            if isinstance(error, OSError):
                reason = f"the result cannot be written ({error.strerror or error})"
                raise PocketGSError(f"{self.folder}: {reason}{where}") from error
            if kept and isinstance(error, Exception):
                reason = str(error) if isinstance(error, PocketGSError) else repr(error)
                raise PocketGSError(f"{reason}{where}") from error
            if kept and isinstance(error, KeyboardInterrupt):
                raise KeyboardInterrupt(f"{precious} is kept in {kept}") from error
            raise
        finally:
            with suppress(OSError):
                remove_staging(self.folder)

    def _publish(self, staging: Path, expected: Iterable[str], outdated: Sequence[str]) -> None:
        new, before = staging / NEW, read_manifest(self.folder)
        for name in expected:
            if not (new / name).is_file():
                raise PocketGSError(f"{new / name}: was written but is missing, expected nobody to change this folder")
        written = {name: digest_of(new / name) for name in files_below(new)}
        going = _matching(before, outdated) - set(written)
        kept = {name: digest for name, digest in before.files.items() if name not in going}
        (new / MANIFEST).parent.mkdir()
        (new / MANIFEST).write_text(Manifest(kept | written, self.source or before.source).encoded(), encoding="utf-8")
        publish(self.folder, staging, before, going)


@contextmanager
def claimed(
    folder: Path, names: Iterable[str] = (), source: str | None = None, outdated: Sequence[str] = ()
) -> Iterator[Claim]:
    """Claim a folder before the work starts: check that a result can be written, and lock out other processes.

    What a killed process left half done there is completed or deleted. If the work fails, a newly created folder is
    deleted.

    Args:
        folder: created if needed.
        names: files that the work will write, as paths or patterns relative to the folder.
        source: see `Claim`.
        outdated: patterns of files of earlier runs that the work will delete, as for `Claim.publishing`.

    Raises:
        PocketGSError: the folder cannot be created or written to, another process is writing to it, it holds a capture,
            or another program's file is in the way.
    """
    made: list[Path] = []
    with ExitStack() as stack:
        try:
            _check_no_capture(folder)
            made += [path for path in (folder, *folder.parents) if not path.exists()]
            stack.callback(_remove_empty, [folder / PRIVATE, *made])
            (folder / PRIVATE).mkdir(parents=True, exist_ok=True)
            stack.enter_context(locked(folder / LOCK, folder))
            complete_pending(folder)
            remove_staging(folder)
            _check_ours(folder, names, outdated)
        except OSError as error:
            raise PocketGSError(f"{folder}: cannot be written to ({error.strerror or error})") from error
        yield Claim(folder, source)


def _check_no_capture(folder: Path) -> None:
    """Refuse a folder with photographs or other files of a capture, which results would mix with.

    Pictures that commands wrote do not count as photographs.
    """
    if not folder.is_dir():
        return
    photographs = (find_photographs_in(each) for each in (folder, folder / USUAL_FOLDER))
    if holds_capture(folder) or (not (folder / MANIFEST).is_file() and any(photographs)):
        raise PocketGSError(f"{folder}: holds a capture, expected another folder for the result")


def _check_ours(folder: Path, names: Iterable[str], outdated: Sequence[str]) -> None:
    # A pattern stands for the folder that its files are in.
    found = [path.relative_to(folder).as_posix() for name in names for path in folder.glob(name)]
    manifest = read_manifest(folder)
    manifest.check_ours(folder, [*names, *found, *_matching(manifest, outdated)])


def _matching(manifest: Manifest, patterns: Sequence[str]) -> set[str]:
    """The files of a manifest that match one of the patterns; see `Claim.publishing`."""
    return {name for name in manifest.files if any(PurePosixPath("/", name).match(pattern) for pattern in patterns)}


def _kept(folder: Path, staging: Path, precious: str) -> Path | None:
    """Move what a block wrote to a folder of its own, if the precious file is complete; None if not.

    Files are written atomically, so a file under its own name is complete. A rename needs no room on a full disk.
    """
    if not (staging / NEW / precious).is_file():
        return None
    kept = folder / f"{KEPT}{uuid.uuid4().hex[:8]}"
    try:
        os.rename(staging / NEW, kept)
    except OSError:
        return None
    return kept


def _remove_empty(folders: Iterable[Path]) -> None:
    with suppress(OSError):
        for folder in folders:
            folder.rmdir()  # fails if the folder is not empty
