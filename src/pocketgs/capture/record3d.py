"""Record3D: an iPhone's RGB-D recording, as an exported .r3d archive or unpacked.

The layout is as the app's author describes it in issues 27, 93 and 99 of marek-simonik/record3d.
"""

from __future__ import annotations

import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from pocketgs.capture.depth_file import LZFSE_PACKAGE, lzfse_is_installed
from pocketgs.capture.image_file import read_grey
from pocketgs.capture.json_fields import Fields, parse_json
from pocketgs.capture.listing import FrameSource, Listing
from pocketgs.capture.paths import CaptureFile, existing_file
from pocketgs.capture.poses import camera_at, rotation_from_quaternion, world_to_camera_from_axes
from pocketgs.capture.sharpness import MOST_FRAMES, REDUCED_SIDE, sharpest_in_windows, sharpness, thinning_warning
from pocketgs.errors import PocketGSError
from pocketgs.opening import read_bytes

FORMAT = "record3d"
LOOKED_FOR = "a .r3d file, or metadata and rgbd/"


def recognises(path: Path) -> bool:
    """Whether the path is a .r3d file or a folder with the content of one."""
    if path.is_file():
        return path.suffix.lower() == ".r3d"
    return (path / "metadata").is_file() and (path / "rgbd").is_dir()


def read(path: Path, images: str | None = None) -> Listing:
    """Choose the sharpest frames and read their cameras. An archive is read as it is, without unpacking it.

    Raises:
        PocketGSError: the archive or its metadata is malformed, no pose has an image, all poses are the same, or
            `images` is given, for which the format has no use.
    """
    if images is not None:
        raise PocketGSError(f"{path}: images='{images}' given, but Record3D's captures keep theirs in rgbd")
    root = path if path.is_dir() else _archive(path)
    metadata = _read_metadata(root)
    poses = metadata.matrix("poses", columns=7)
    if len(poses) > 1 and np.all(poses == poses[0]):
        raise PocketGSError(
            f"{metadata.where}: all {len(poses)} poses are the same; recordings of the selfie camera have none"
        )
    files = {index: _member(root, f"rgbd/{index}.jpg") for index in range(len(poses))}
    present = {index: file for index, file in files.items() if file is not None}
    if not present:
        raise PocketGSError(f"{metadata.where}: none of its {len(poses)} poses has an image rgbd/N.jpg")
    chosen = _sharpest(present)
    intrinsics = _intrinsics(metadata, len(poses))
    depth_shape, depth_warning = _depth_shape(root, metadata, chosen[0])
    frames = [
        _frame(root, metadata, index, present[index], poses[index], intrinsics[index], depth_shape) for index in chosen
    ]
    warnings = _mismatch_warning(root, metadata, len(present), len(poses)) + depth_warning
    return Listing(
        FORMAT, frames, metric=True, warnings=warnings + thinning_warning(str(path), len(chosen), len(present))
    )


def _frame(
    root: CaptureFile,
    metadata: Fields,
    index: int,
    image: CaptureFile,
    pose: np.ndarray,
    intrinsics: np.ndarray,
    depth_shape: tuple[int, int] | None,
) -> FrameSource:
    where = f"{metadata.where}, frame {index}"
    qx, qy, qz, qw = pose[:4]
    # From camera to world, in OpenGL axes: x right, y up, z back (issues 36 and 64).
    axes = rotation_from_quaternion(np.array([qw, qx, qy, qz]), where) * np.array([1.0, -1.0, -1.0])
    fx, fy, cx, cy = intrinsics
    depth = None if depth_shape is None else _member(root, f"rgbd/{index}.depth")
    return FrameSource(
        name=f"rgbd/{index}.jpg",
        image=image,
        camera=camera_at(
            where,
            (metadata.number("w"), metadata.number("h")),
            (fx, fy),
            (cx, cy),
            world_to_camera_from_axes(axes, pose[4:], where),
        ),
        depth_path=depth,
        depth_unit=1.0,
        depth_shape=depth_shape,
        confidence_path=None if depth is None else _member(root, f"rgbd/{index}.conf"),
    )


def _archive(path: Path) -> zipfile.Path:
    try:
        return zipfile.Path(zipfile.ZipFile(path))
    except Exception as error:  # zipfile raises whatever a damaged archive makes it trip over
        raise PocketGSError(f"{path}: not a readable .r3d archive ({error})") from error


def _member(root: CaptureFile, name: str) -> CaptureFile | None:
    """A file of the recording, or None where it is absent."""
    if isinstance(root, Path):
        return existing_file(root, name, str(root))
    member = root / name
    return member if member.is_file() else None


def _read_metadata(root: CaptureFile) -> Fields:
    file = _member(root, "metadata")
    if file is None:
        raise PocketGSError(f"{root}: no file metadata, expected the content of a .r3d archive")
    try:
        content = read_bytes(file)
    except PocketGSError:
        raise
    except Exception as error:
        raise PocketGSError(f"{file}: cannot be read ({error})") from error
    return parse_json(content, str(file))


def _sharpest(files: dict[int, CaptureFile]) -> list[int]:
    """The numbers of the frames to use, ascending."""
    if len(files) <= MOST_FRAMES:
        return list(files)
    with ThreadPoolExecutor() as pool:
        values = list(pool.map(lambda file: sharpness(read_grey(file, REDUCED_SIDE)), files.values()))
    indices = list(files)
    return [indices[place] for place in sharpest_in_windows(values, MOST_FRAMES)]


def _intrinsics(metadata: Fields, count: int) -> np.ndarray:
    """(count, 4) fx, fy, cx, cy of each frame in pixels of the image."""
    if metadata.values.get("perFrameIntrinsicCoeffs"):
        table = metadata.matrix("perFrameIntrinsicCoeffs", columns=4)
        if len(table) != count:
            raise PocketGSError(
                f"{metadata.where}: field 'perFrameIntrinsicCoeffs' has {len(table)} rows, expected {count} as 'poses'"
            )
        return table
    # By columns: fx, 0, 0, 0, fy, 0, cx, cy, 1. Of the first frame.
    matrix = metadata.numbers("K", 9).reshape(3, 3).T
    return np.tile([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]], (count, 1))


def _depth_shape(root: CaptureFile, metadata: Fields, example: int) -> tuple[tuple[int, int] | None, tuple[str, ...]]:
    """Rows and columns of the depth maps, None if there are none that can be read; and what to warn of."""
    if _member(root, f"rgbd/{example}.depth") is None:
        return None, ()
    if not lzfse_is_installed():
        return None, (f"{root}: its depth maps are left out, reading them needs the package {LZFSE_PACKAGE}",)
    return (round(metadata.number("dh")), round(metadata.number("dw"))), ()


def _mismatch_warning(root: CaptureFile, metadata: Fields, present: int, poses: int) -> tuple[str, ...]:
    if present < poses:
        return (f"{metadata.where}: {poses - present} of {poses} poses have no image",)
    if _member(root, f"rgbd/{poses}.jpg") is not None:
        return (f"{metadata.where}: lists {poses} poses, the images beyond them are left out",)
    return ()
