"""The images that structure from motion works on, gathered in one folder."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

from PIL import Image

from pocketgs.capture.image_file import read_grey, read_size
from pocketgs.capture.photograph_copy import place_masks, place_photograph
from pocketgs.capture.unposed import PHOTOGRAPH_SUFFIXES, find_photographs, is_video
from pocketgs.capture.video_file import read_frames, sharpest_frames
from pocketgs.errors import PocketGSError

FEWEST = 3
JPEG_QUALITY = 95


def source_files(source: Path) -> list[Path]:
    """The video, or the photographs sorted by name.

    Raises:
        PocketGSError: there is no such file or folder, or there are too few photographs.
    """
    if is_video(source):
        return [source]
    if not source.exists():
        raise PocketGSError(f"{source}: no such file or folder, expected a video or a folder of photographs")
    photographs = find_photographs(source)
    if len(photographs) < FEWEST:
        kinds = ", ".join(sorted(PHOTOGRAPH_SUFFIXES))
        raise PocketGSError(
            f"{source}: {len(photographs)} photographs, expected a video or a folder with at least {FEWEST} ({kinds})"
        )
    return photographs


def gather(source: Path, folder: Path, most_frames: int) -> None:
    """Put a video's sharpest frames or the photographs into a new folder; the originals stay as they are.

    Photographs stand upright, see `place_photograph`; masks that lie beside them go into a folder `masks` beside the
    new one.

    Raises:
        PocketGSError: a file cannot be decoded, or there are too few.
    """
    files = source_files(source)
    folder.mkdir()
    if is_video(source):
        _extract(source, folder, most_frames)
        return
    placed = {}
    for photograph in files:
        # A file that is cut off would otherwise come to light after minutes of work. JPEG is decoded at 1/8 only.
        read_grey(photograph, least_side=1)
        placed[photograph] = place_photograph(photograph, folder)
    place_masks(source, placed, folder.parent / "masks")


def names_by_size(folder: Path) -> list[list[str]]:
    """The names of a folder's images, sorted, apart for each image size: what one camera took has one size."""
    groups: dict[tuple[int, int], list[str]] = defaultdict(list)
    for path in sorted(folder.iterdir()):
        groups[read_size(path)].append(path.name)
    return list(groups.values())


def _extract(video: Path, folder: Path, most_frames: int) -> None:
    chosen = sharpest_frames(video, most_frames)
    if len(chosen) < FEWEST:
        raise PocketGSError(f"{video}: {len(chosen)} frames, expected at least {FEWEST}")
    for index, frame in read_frames(video, chosen):
        Image.fromarray(frame).save(folder / f"frame_{index:06d}.jpg", quality=JPEG_QUALITY, subsampling=0)
