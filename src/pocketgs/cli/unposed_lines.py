"""What `pocketgs info` says of photographs and videos without poses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from pocketgs.capture.decoding.image_file import UndecodableImageError, read_image
from pocketgs.capture.decoding.video_file import early_end, video_size
from pocketgs.capture.open import capture_name
from pocketgs.capture.unposed import find_photographs, is_video, left_out_formats
from pocketgs.errors import counted, listed
from pocketgs.structure_from_motion.exif import Exif, read_exif

MAX_KINDS = 4


def unposed_lines(path: Path) -> list[str]:
    """Describe a video, or photographs by their headers.

    Raises:
        PocketGSError: a file cannot be read, or the video cannot be decoded.
    """
    if is_video(path):
        width, height = video_size(path)
        described = [f"{capture_name(path)}: a video of {width}x{height} pixels, without poses"]
        described += [f"warning: {warning}"] if (warning := early_end(path)) else []
    else:
        described = _photograph_lines(path)
    return [*described, "train finds poses by structure from motion, and so does pose"]


def _photograph_lines(path: Path) -> list[str]:
    photographs, sizes, found, damaged = find_photographs(path), [], list[Exif](), []
    for photograph in photographs:
        try:
            size, exif = read_image(photograph, lambda image: (image.size, read_exif(image)))
        except UndecodableImageError:
            damaged.append(photograph.name)
        else:
            sizes.append("{}x{}".format(*size))
            found.append(exif)
    lengths = sum(exif.focal_ratio is not None for exif in found)
    places = sum(exif.place is not None for exif in found)
    lines = [
        f"{capture_name(path)}: {counted(len(photographs), 'photograph', 'photographs')} without poses",
        f"sizes in pixels: {_by_number(sizes)}",
        f"EXIF: {_by_number(exif.camera or 'no camera' for exif in found)}; focal length in {lengths}, GPS in {places}",
    ]
    warnings = [*left_out_formats(photographs)]
    warnings += [f"cannot be decoded: {listed(damaged, MAX_KINDS)}"] if damaged else []
    return lines + [f"warning: {warning}" for warning in warnings]


def _by_number(kinds: Iterable[str]) -> str:
    """Each kind and how often it is there, the most frequent first."""
    counts = [f"{kind} ({count})" for kind, count in Counter(kinds).most_common()]
    return listed(counts, MAX_KINDS) or "none"
