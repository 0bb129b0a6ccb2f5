"""Reader of Record3D recordings (iPhone RGB-D): .r3d archives, packed or unpacked, and exports as "EXR + JPG".

The app's author documents the archive layout in issues 27, 93 and 99 of marek-simonik/record3d; the export's layout is
that of a real one. Both have the same metadata.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pocketgs.capture.listing import FrameSource, Listing
from pocketgs.capture.poses import camera_at, rotation_from_quaternion, world_to_camera_from_opengl
from pocketgs.capture.sharpness import sharpest_photographs, thinning_warning
from pocketgs.errors import PocketGSError, clipped
from pocketgs.files.json_fields import Fields, parse_json
from pocketgs.files.opening import CaptureFile, checked, read_bytes
from pocketgs.files.paths import existing_file, without_here

FORMAT = "record3d"
LOOKED_FOR = "a .r3d file, or metadata and rgbd/, or metadata.json and rgb/ with poses"


@dataclass(frozen=True)
class Layout:
    """Paths of the parts of a recording; `{}` stands for a frame's number, which is also the index of its pose.

    Attributes:
        metadata, image, depth, confidence: paths inside the recording.
    """

    metadata: str
    image: str
    depth: str
    confidence: str


ARCHIVE = Layout("metadata", "rgbd/{}.jpg", "rgbd/{}.depth", "rgbd/{}.conf")
"""Depths and confidences are compressed with LZFSE, without their size."""

EXPORT = Layout("metadata.json", "rgb/{}.jpg", "depth/{}.exr", "conf/{}.png")


@dataclass(frozen=True)
class Recording:
    """The files of a recording, in a folder or in an archive."""

    root: CaptureFile
    layout: Layout

    def file(self, part: str, number: int | None = None) -> CaptureFile | None:
        """The file of a part of the `Layout`, or None if it is missing."""
        name = getattr(self.layout, part).format(number)
        if isinstance(self.root, Path):
            return existing_file(self.root, name, str(self.root))
        member = self.root / name
        return member if member.is_file() else None


def recognises(path: Path) -> bool:
    """Whether the path is a .r3d file, an unpacked one, or an export as EXR and JPG."""
    if path.is_file():
        return is_archive(path)
    return _is_unpacked(path) or _is_export(path)


def is_archive(path: Path) -> bool:
    """Whether the path is a .r3d file, and not one of the hidden files that macOS adds."""
    return path.suffix.lower() == ".r3d" and not path.name.startswith(".") and path.is_file()


def read(path: Path, images: str | None = None) -> Listing:
    """Choose the sharpest frames and read their cameras. Archives are read without unpacking.

    Raises:
        PocketGSError: the archive or its metadata is malformed, no pose has an image, all poses are equal, or `images`
            is given, which the format does not support.
    """
    if images is not None:
        raise PocketGSError(f"{path}: images='{images}' given, but Record3D's captures have one folder of images")
    archived = path.is_file() or _is_unpacked(path)
    recording = Recording(path if path.is_dir() else _archive(path), ARCHIVE if archived else EXPORT)
    metadata = _read_metadata(recording)
    poses = metadata.matrix("poses", columns=7)
    if len(poses) > 1 and np.all(poses == poses[0]):
        raise PocketGSError(
            f"{metadata.where}: all {len(poses)} poses are the same; recordings of the selfie camera have none"
        )
    files = {number: recording.file("image", number) for number in range(len(poses))}
    present = {number: file for number, file in files.items() if file is not None}
    if not present:
        expected = recording.layout.image.format("N")
        raise PocketGSError(f"{metadata.where}: none of its {len(poses)} poses has an image {expected}")
    chosen = sharpest_photographs(present)
    intrinsics = _intrinsics(metadata, len(poses))
    shape = _depth_shape(metadata) if archived else None
    frames = [_frame(recording, metadata, number, poses[number], intrinsics[number], shape) for number in chosen]
    warnings = _mismatch_warning(recording, metadata, len(present), len(poses))
    if archived and shape is None and any(frame.depth_path for frame in frames):
        frames = [replace(frame, depth_path=None, confidence_path=None) for frame in frames]
        warnings += (f"{metadata.where}: depth maps are left out, no fields 'dh' and 'dw' state their size",)
    warnings += thinning_warning(str(path), len(chosen), len(present))
    return Listing(FORMAT, frames, metric=True, warnings=warnings)


def _is_unpacked(path: Path) -> bool:
    return (path / ARCHIVE.metadata).is_file() and (path / "rgbd").is_dir()


def _is_export(path: Path) -> bool:
    """Whether a metadata.json is Record3D's: other programs write that file too, but without poses and a matrix K."""
    file = path / EXPORT.metadata
    if not file.is_file() or not (path / "rgb").is_dir():
        return False
    content = file.read_bytes()
    return b'"poses"' in content and b'"K"' in content


def _frame(
    recording: Recording,
    metadata: Fields,
    number: int,
    pose: np.ndarray,
    intrinsics: np.ndarray,
    depth_shape: tuple[int, int] | None,
) -> FrameSource:
    where = f"{metadata.where}, frame {number}"
    qx, qy, qz, qw = pose[:4]
    # Camera to world, in OpenGL axes: x right, y up, z back (issues 36 and 64).
    axes = rotation_from_quaternion(np.array([qw, qx, qy, qz]), where)
    fx, fy, cx, cy = intrinsics
    image, depth = recording.file("image", number), recording.file("depth", number)
    assert image is not None
    return FrameSource(
        name=recording.layout.image.format(number),
        image=image,
        camera=camera_at(
            where,
            (metadata.number("w"), metadata.number("h")),
            (fx, fy),
            (cx, cy),
            world_to_camera_from_opengl(axes, pose[4:], where),
        ),
        depth_path=depth,
        depth_unit=1.0,
        depth_shape=depth_shape,
        confidence_path=None if depth is None else recording.file("confidence", number),
    )


def _depth_shape(metadata: Fields) -> tuple[int, int] | None:
    """Rows and columns of compressed depth maps, or None if the metadata does not state them."""
    rows, columns = (metadata.optional_number(name) for name in ("dh", "dw"))
    return None if rows is None or columns is None else (round(rows), round(columns))


def _archive(path: Path) -> zipfile.Path:
    checked(path)
    try:
        archive = zipfile.ZipFile(path)
        for member in archive.infolist():
            member.filename = without_here(member.filename)
        # By these names members are opened.
        archive.NameToInfo = {member.filename: member for member in archive.infolist()}
        return zipfile.Path(archive)
    except Exception as error:  # zipfile raises different types for different damage
        raise PocketGSError(f"{path}: not a readable .r3d archive ({clipped(error)})") from error


def _read_metadata(recording: Recording) -> Fields:
    file = recording.file("metadata")
    if file is None:
        raise PocketGSError(f"{recording.root}: no file metadata, expected the content of a .r3d archive")
    try:
        content = read_bytes(file)
    except PocketGSError:
        raise
    except Exception as error:
        raise PocketGSError(f"{file}: cannot be read ({clipped(error)})") from error
    return parse_json(content, str(file))


def _intrinsics(metadata: Fields, count: int) -> np.ndarray:
    """(count, 4) fx, fy, cx, cy of each frame in pixels of the image."""
    if metadata.values.get("perFrameIntrinsicCoeffs"):
        table = metadata.matrix("perFrameIntrinsicCoeffs", columns=4)
        if len(table) != count:
            raise PocketGSError(
                f"{metadata.where}: field 'perFrameIntrinsicCoeffs' has {len(table)} rows, expected {count} as 'poses'"
            )
        return table
    # By columns: fx, 0, 0, 0, fy, 0, cx, cy, 1. For the first frame.
    matrix = metadata.numbers("K", 9).reshape(3, 3).T
    return np.tile([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]], (count, 1))


def _mismatch_warning(recording: Recording, metadata: Fields, present: int, poses: int) -> tuple[str, ...]:
    if present < poses:
        return (f"{metadata.where}: {poses - present} of {poses} poses have no image",)
    if recording.file("image", poses) is not None:
        return (f"{metadata.where}: lists {poses} poses, the images beyond them are left out",)
    return ()
