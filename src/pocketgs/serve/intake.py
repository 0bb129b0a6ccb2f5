"""Checking a complete upload, and making its thumbnail, in a process of its own.

What was uploaded is decoded here and while it trains, but never in the server: a file that crashes a decoder, or takes
all its memory, ends only this process.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from pocketgs.capture.decoding.image_file import read_header
from pocketgs.capture.decoding.video_file import VideoFrame, read_frames, video_size
from pocketgs.capture.open import lacks_poses, read_listing, video_of
from pocketgs.capture.unposed import find_photographs, is_video
from pocketgs.errors import USER_ERROR, PocketGSError
from pocketgs.serve.archive import unpack
from pocketgs.serve.child import exit_when_gone
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
    picture = _checked(video_of(input_of(folder, entry)))
    if isinstance(picture, VideoFrame):
        [(_, pixels)] = read_frames(picture.path, [picture.index])
        write_thumbnail(folder / THUMBNAIL, pixels)
    elif isinstance(picture, Path):
        write_thumbnail(folder / THUMBNAIL, picture)


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


def _checked(source: Path) -> object:
    """The picture that shows what a capture is of: an image file, a frame of a video, or a member of an archive."""
    if is_video(source):
        video_size(source)
        return VideoFrame(source, 0)
    if lacks_poses(source):
        photographs = find_photographs(source)
        for photograph in photographs:
            read_header(photograph)
        return photographs[len(photographs) // 2]
    frames = read_listing(source).frames
    return frames[len(frames) // 2].image


if __name__ == "__main__":
    main()
