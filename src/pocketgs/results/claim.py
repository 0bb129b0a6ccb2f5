"""An output folder for as long as one command writes there."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from pocketgs.capture.open import holds_capture
from pocketgs.capture.unposed import USUAL_FOLDER, find_photographs_in
from pocketgs.errors import PocketGSError
from pocketgs.files.journal import LOCK, NEW, complete_pending, new_staging, publish, remove_staging
from pocketgs.files.lock import locked
from pocketgs.files.manifest import MANIFEST, PRIVATE, Manifest, digest_of, files_below, read_manifest


@dataclass(frozen=True)
class Claim:
    """An output folder that no other process writes to.

    Attributes:
        folder: where.
        source: what tells the capture of a run from others, see `source_of`; None for what is no run.
    """

    folder: Path
    source: str | None = None

    @contextmanager
    def publishing(self, expected: Iterable[str] = (), outdated: Sequence[str] = ()) -> Iterator[Path]:
        """Give an empty folder to write to; when the block succeeds, what is in it goes to the claimed folder as one.

        Args:
            expected: files that the block must have written.
            outdated: patterns of files that earlier runs wrote and that go if the block writes none of their name.

        Raises:
            PocketGSError: the folder cannot be written to, what the block has written is not there any more, or a file
                of somebody else has come into its way; a result that is complete is kept in the last case.
        """
        try:
            staging = new_staging(self.folder)
            yield staging / NEW
            self._publish(staging, expected, outdated)
        except OSError as error:
            raise PocketGSError(f"{self.folder}: the result cannot be written ({error.strerror or error})") from error
        finally:
            with suppress(OSError):
                remove_staging(self.folder)

    def _publish(self, staging: Path, expected: Iterable[str], outdated: Sequence[str]) -> None:
        new, before = staging / NEW, read_manifest(self.folder)
        for name in expected:
            if not (new / name).is_file():
                raise PocketGSError(f"{new / name}: was written and is gone, expected nobody to change this folder")
        written = {name: digest_of(new / name) for name in files_below(new)}
        going = {name for name in before.files if any(Path(name).match(pattern) for pattern in outdated)} - set(written)
        kept = {name: digest for name, digest in before.files.items() if name not in going}
        (new / MANIFEST).parent.mkdir()
        (new / MANIFEST).write_text(Manifest(kept | written, self.source or before.source).encoded(), encoding="utf-8")
        publish(self.folder, staging, before, going)


@contextmanager
def claimed(folder: Path, names: Iterable[str] = (), source: str | None = None) -> Iterator[Claim]:
    """Claim a folder before the work starts: find out that a result can be written, and let nobody else write.

    What a killed process has left half done there is completed or cleared away. If nothing comes of the work, a folder
    that had to be made goes again.

    Args:
        folder: made if need be.
        names: files that the work is to write, as paths in the folder or patterns of such.
        source: as of `Claim`.

    Raises:
        PocketGSError: the folder cannot be made or written to, another process is writing to it, it holds a capture,
            or a file that is not ours is where one of ours is to be.
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
            _check_ours(folder, names)
        except OSError as error:
            raise PocketGSError(f"{folder}: cannot be written to ({error.strerror or error})") from error
        yield Claim(folder, source)


def _check_no_capture(folder: Path) -> None:
    """Refuse a folder of photographs, or whatever a capture's files may be: results would stand among them.

    Pictures that commands have written are no photographs.
    """
    if not folder.is_dir():
        return
    photographs = (find_photographs_in(each) for each in (folder, folder / USUAL_FOLDER))
    if holds_capture(folder) or (not (folder / MANIFEST).is_file() and any(photographs)):
        raise PocketGSError(f"{folder}: holds a capture, expected another folder for the result")


def _check_ours(folder: Path, names: Iterable[str]) -> None:
    # A pattern stands among them for the folder that its files are to be in.
    found = [path.relative_to(folder).as_posix() for name in names for path in folder.glob(name)]
    read_manifest(folder).check_ours(folder, [*names, *found])


def _remove_empty(folders: Iterable[Path]) -> None:
    with suppress(OSError):
        for folder in folders:
            folder.rmdir()  # refuses if anything is in there
