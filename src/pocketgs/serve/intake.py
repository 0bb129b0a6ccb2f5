"""Checking a complete upload, and making its thumbnail, in a process of its own.

What was uploaded is decoded here and while it trains, but never in the server: a file that crashes a decoder, or takes
all its memory, ends only this process.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from pocketgs.capture.decoding.image_file import UndecodableImageError, read_header
from pocketgs.capture.decoding.video_file import VideoFrame, read_frames, video_size
from pocketgs.capture.open import lacks_poses, read_listing, video_of
from pocketgs.capture.unposed import find_photographs, is_video
from pocketgs.errors import USER_ERROR, PocketGSError
from pocketgs.serve.archive import unpack
from pocketgs.serve.child import exit_when_gone
from pocketgs.serve.declaration import FEWEST_PHOTOGRAPHS
from pocketgs.serve.entry import Entry, read_entry
from pocketgs.serve.shelf import ABOUT, CAPTURE, THUMBNAIL, UPLOAD, input_of
from pocketgs.serve.thumbnail import write_thumbnail


def main() -> None:
    """Check a capture; what is wrong is printed, with status 2.

    The arguments are the capture's folder, the bound of bytes, and the number of the server's process. Without a server
    the check ends: the next one checks again, in the same folder.
    """
    folder, max_bytes, server = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    exit_when_gone(server)
    try:
        check(folder, read_entry(folder / ABOUT), max_bytes)
    except (PocketGSError, OSError) as error:
        print(error)
        sys.exit(USER_ERROR)


def check(folder: Path, entry: Entry, max_bytes: int) -> None:
    """Check that `pocketgs train` can read an upload, and make its thumbnail. Archives are unpacked.

    Args:
        folder: of the capture.
        entry: what is known of it.
        max_bytes: bound of what an archive unpacks to.

    Raises:
        PocketGSError: it cannot be read.
        OSError: something cannot be written.
    """
    if entry.files[0].stored.endswith(".zip"):
        _unpack(folder, folder / UPLOAD / entry.files[0].stored, max_bytes)
    _show_middle(folder / THUMBNAIL, _pictures(video_of(input_of(folder, entry))))


def _unpack(folder: Path, archive: Path, max_bytes: int) -> None:
    """Unpack an archive and delete it, or nothing."""
    if not archive.is_file():  # it was unpacked before the server was ended
        return
    partial, unpacked = folder / "unpacking", folder / CAPTURE
    for leftover in (partial, unpacked):
        shutil.rmtree(leftover, ignore_errors=True)
    try:
        unpack(archive, partial, max_bytes)
    except (PocketGSError, OSError) as error:
        shutil.rmtree(partial, ignore_errors=True)
        raise PocketGSError(f"{archive}: {error}") from error
    partial.rename(unpacked)
    archive.unlink()


def _pictures(source: Path) -> Sequence[object]:
    """What a capture consists of: image files, frames of videos, or members of an archive."""
    if is_video(source):
        video_size(source)
        return [VideoFrame(source, 0)]
    if lacks_poses(source):
        return _sound(find_photographs(source))
    return [frame.image for frame in read_listing(source).frames]


def _sound(photographs: Sequence[Path]) -> list[Path]:
    """Those whose headers can be read: training leaves out the others, if enough are left.

    Raises:
        PocketGSError: too few are left, or a photograph is too large.
    """
    sound, damaged = [], []
    for photograph in photographs:
        try:
            read_header(photograph)
            sound.append(photograph)
        except UndecodableImageError:
            damaged.append(photograph)
    if damaged and len(sound) < FEWEST_PHOTOGRAPHS:
        left = f"{len(sound)} of {len(photographs)} photographs can be read, expected at least {FEWEST_PHOTOGRAPHS}"
        raise PocketGSError(f"{damaged[0]}: is damaged, or no image: {left}")
    return sound


def _show_middle(thumbnail: Path, pictures: Sequence[object]) -> None:
    """Make a thumbnail of the middle picture, or of the nearest one that is not damaged.

    Raises:
        PocketGSError: all are damaged, or the thumbnail cannot be written.
    """
    middle = len(pictures) // 2
    nearest = sorted(range(len(pictures)), key=lambda index: abs(index - middle))
    for picture in (pictures[index] for index in nearest):
        with suppress(UndecodableImageError):
            _show(thumbnail, picture)
            return
    raise PocketGSError(f"{pictures[middle]}: is damaged, or no image, and so are all others: upload whole photographs")


def _show(thumbnail: Path, picture: object) -> None:
    if isinstance(picture, VideoFrame):
        [(_, pixels)] = read_frames(picture.path, [picture.index])
        write_thumbnail(thumbnail, pixels)
    elif isinstance(picture, Path):
        write_thumbnail(thumbnail, picture)


if __name__ == "__main__":
    main()
