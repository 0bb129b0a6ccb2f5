"""Photographs or a video without poses, the input of structure from motion."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from pocketgs.capture.decoding.video_file import VIDEO_SUFFIXES, VideoFrame
from pocketgs.errors import counted
from pocketgs.files.opening import CaptureFile
from pocketgs.files.paths import IMAGE_SUFFIXES, is_folder_of_photographs, list_images

USUAL_FOLDER = "images"
FORMATS = ((".heic", ".heif"), (".jpg", ".jpeg", ".jpe", ".jfif"), (".mpo",), (".tif", ".tiff"), (".png",))
"""Suffixes of formats, those that cameras write first. Others come after them."""

POSED_RECORD = "posed.json"
"""Name of the record of how this package has found a capture's poses, in the capture's folder."""


def is_video(path: Path) -> bool:
    """Whether the path is a file with the suffix of a video."""
    return path.suffix.lower() in VIDEO_SUFFIXES and path.is_file()


def find_photographs(folder: Path) -> list[Path]:
    """The photographs directly in a folder or in its folder `images`, wherever there are more, sorted by name.

    A few pictures beside `images` are a cover or notes. Without either, those of the only folder of
    `photographs_by_folder`.
    """
    found = _in_usual_places(folder)
    if found:
        return found
    holding = list(photographs_by_folder(folder).values())
    return holding[0] if len(holding) == 1 else []


def _in_usual_places(folder: Path) -> list[Path]:
    return max(map(find_photographs_in, (folder, folder / USUAL_FOLDER)), key=len)


def find_photographs_in(folder: Path) -> list[Path]:
    """The photographs directly in a folder, sorted by name; empty if there is no such folder.

    Of photographs in several formats, such as an iPhone's .HEIC and the .jpg that was made of it, only the camera's
    counts: the others would be views of their own, and some of them held out.
    """
    images = list_images(folder) if folder.is_dir() else []
    best: dict[str, tuple[int, str]] = {}
    for image in images:
        if image.stat().st_size:  # clouds leave empty files where they have not transferred any
            best[_name(image)] = min(_format(image), best.get(_name(image), _format(image)))
    return [image for image in images if _format(image) == best.get(_name(image), _format(image))]


def left_out_formats(photographs: Iterable[Path]) -> list[str]:
    """A warning, if `find_photographs_in` has passed over images beside the photographs that it found."""
    used = {*photographs}
    others = sorted({image for folder in {path.parent for path in used} for image in list_images(folder)} - used)
    if not others:
        return []
    formats = counted(len(others), "image is another format", "images are other formats")
    return [f"{formats} of the same photographs and left out, such as {others[0].name}"]


def _name(image: Path) -> str:
    """The name of an image in whatever format: `1` of 1.HEIC, 1.jpg, and 1.HEIC.jpg."""
    stem = Path(image.stem)
    return stem.stem if stem.suffix.lower() in IMAGE_SUFFIXES else stem.name


def _format(image: Path) -> tuple[int, str]:
    """An image's format: its place in `FORMATS`, and the suffix of those that have none there."""
    suffix = image.suffix.lower()
    known = (place for place, suffixes in enumerate(FORMATS) if suffix in suffixes)
    return next(((place, "") for place in known), (len(FORMATS), suffix))


def photographs_by_folder(folder: Path) -> dict[Path, list[Path]]:
    """The photographs of the folders of a folder, or else of the folders of these, as cameras nest them: DCIM/100APPLE.

    By the folder that they lie in, sorted. Each inner folder counts once, and is searched like one that is named: a few
    pictures beside its `images` are a preview.
    """
    return _in_folders(folder) or dict(item for path in _inner(folder) for item in _in_folders(path).items())


def _in_folders(folder: Path) -> dict[Path, list[Path]]:
    found = filter(None, map(_in_usual_places, _inner(folder)))
    return {photographs[0].parent: photographs for photographs in found}


def _inner(folder: Path) -> list[Path]:
    """The folders in a folder that may hold photographs. Captures that `pocketgs pose` made count if no other does."""
    inner = [path for path in sorted(folder.iterdir()) if is_folder_of_photographs(path)] if folder.is_dir() else []
    return [path for path in inner if not (path / POSED_RECORD).is_file()] or inner


def videos_in(folder: Path) -> list[Path]:
    """The videos directly in a folder, sorted by name; empty if there is no such folder."""
    files = sorted(folder.iterdir()) if folder.is_dir() else ()
    return [file for file in files if is_video(file) and not file.name.startswith(".")]


def only_video(folder: Path) -> Path | None:
    """The only video directly in a folder, or else in the only folder in it that contains videos.

    None if there is no such, or if the folder or one in it holds photographs too.
    """
    if _in_usual_places(folder) or _in_folders(folder):
        return None
    videos = videos_in(folder)
    if not videos and folder.is_dir():
        holding = [found for path in sorted(folder.iterdir()) if (found := videos_in(path))]
        videos = holding[0] if len(holding) == 1 else []
    return videos[0] if len(videos) == 1 else None


def holds_photographs(path: Path) -> bool:
    """Whether the path is a video, or a folder with photographs."""
    return is_video(path) or bool(find_photographs(path))


def by_number(name: str) -> list[tuple[int, str]]:
    """A key that sorts names in the order of capture: numbers by value, so that 2.jpg comes before 10.jpg."""
    return [(int(part), "") if part.isdecimal() else (0, part) for part in re.split(r"(\d+)", name)]


def few_posed(
    files: Iterable[CaptureFile | VideoFrame | None],
    masks: Iterable[CaptureFile | None],
    capture: Path,
    where: str,
) -> tuple[str, ...]:
    """A warning if most images in the folders of those with a pose have none, or no warning.

    Of captures that `pocketgs pose` made, it has told which images it could not place, and why.

    Args:
        files: the images with a pose. Those that are no files on disk do not count.
        masks: files that are masks of these.
        capture: the capture's folder.
        where: what states the poses, for the message.
    """
    if (capture / POSED_RECORD).is_file():
        return ()
    posed = {file for file in files if isinstance(file, Path)}
    folders = {file.parent for file in posed}
    present = len({image for folder in folders for image in find_photographs_in(folder)} - {*masks})
    if 2 * len(posed) >= present:
        return ()
    return (f"only {len(posed)} of {present} images have a pose in {where}: let pocketgs pose find all anew",)
