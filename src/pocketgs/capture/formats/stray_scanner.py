"""Reader of Stray Scanner recordings: an iPhone's video with a pose and, with LiDAR, a depth map per frame.

The layout is documented in docs/format.md of the app's repository, strayrobots/scanner.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pocketgs.capture.decoding.video_file import VideoFrame, sharpness_of_frames, video_size
from pocketgs.capture.listing import FrameSource, Listing
from pocketgs.capture.poses import ARKIT_PIXEL_CENTRE, camera_at, rotation_from_quaternion, world_to_camera_from_axes
from pocketgs.capture.sharpness import MAX_FRAMES, sharpest_in_windows, thinning_warning
from pocketgs.errors import PocketGSError, clipped
from pocketgs.files.opening import read_bytes
from pocketgs.files.paths import existing_file

FORMAT = "stray-scanner"
LOOKED_FOR = "odometry.csv and camera_matrix.csv"
VIDEO, ODOMETRY, CAMERA_MATRIX = "rgb.mp4", "odometry.csv", "camera_matrix.csv"
POSE_COLUMNS = ("frame", "x", "y", "z", "qx", "qy", "qz", "qw")
INTRINSIC_COLUMNS = ("fx", "fy", "cx", "cy")


@dataclass(frozen=True)
class Odometry:
    """One line of `odometry.csv`: the pose, (4, 4) world to camera, and fx, fy, cx, cy or None."""

    pose: np.ndarray
    intrinsics: tuple[float, ...] | None


def recognises(path: Path) -> bool:
    """Whether the folder holds Stray Scanner's two tables."""
    return (path / ODOMETRY).is_file() and (path / CAMERA_MATRIX).is_file()


def read(path: Path, images: str | None = None) -> Listing:
    """Choose the sharpest frames of the video and read their poses.

    Raises:
        PocketGSError: the video or a table is missing or malformed, no frame of the video has a pose, or `images` is
            given, which the format does not support.
    """
    if images is not None:
        raise PocketGSError(
            f"{path}: images='{images}' given, but Stray Scanner's captures keep their images in a video"
        )
    video = existing_file(path, VIDEO, str(path))
    if video is None:
        raise PocketGSError(f"{path}: no {VIDEO}, expected the video that {ODOMETRY} belongs to")
    matrix = _read_camera_matrix(path / CAMERA_MATRIX)
    shared = (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    poses = _read_odometry(path / ODOMETRY)
    sharpness = sharpness_of_frames(video)
    posed = [index for index in poses if index < len(sharpness)]
    if not posed:
        raise PocketGSError(f"{path / ODOMETRY}: no pose belongs to one of the {len(sharpness)} frames of {VIDEO}")
    chosen = [posed[place] for place in sharpest_in_windows([sharpness[index] for index in posed], MAX_FRAMES)]
    # Poses and intrinsics refer to the sensor's pixels, so the video is read as stored.
    size = video_size(video, upright=False)
    frames = [_frame(path, video, index, shared, size, poses[index]) for index in chosen]
    warnings = _mismatch_warning(path, len(posed), len(poses), len(sharpness))
    warnings += thinning_warning(str(video), len(chosen), len(posed))
    return Listing(FORMAT, frames, metric=True, warnings=warnings)


def _frame(
    path: Path, video: Path, index: int, shared: tuple[float, ...], size: tuple[int, int], odometry: Odometry
) -> FrameSource:
    where = f"{path / (CAMERA_MATRIX if odometry.intrinsics is None else ODOMETRY)}, frame {index}"
    fx, fy, cx, cy = odometry.intrinsics or shared
    depth = existing_file(path, f"depth/{index:06d}", str(path), (".png", ".npy"))
    return FrameSource(
        name=f"{VIDEO}/{index:06d}",
        image=VideoFrame(video, index),
        camera=camera_at(where, size, (fx, fy), (cx + ARKIT_PIXEL_CENTRE, cy + ARKIT_PIXEL_CENTRE), odometry.pose),
        depth_path=depth,
        confidence_path=None if depth is None else existing_file(path, f"confidence/{index:06d}.png", str(path)),
    )


def _mismatch_warning(path: Path, posed: int, poses: int, frames: int) -> tuple[str, ...]:
    if posed == poses == frames:
        return ()
    return (f"{path}: {VIDEO} has {frames} frames and {ODOMETRY} {poses} poses, the {posed} that match are used",)


def _read_camera_matrix(path: Path) -> np.ndarray:
    """(3, 3) intrinsic matrix, one row per line."""
    rows = _read_rows(path)
    try:
        matrix = np.array([[float(value) for value in row] for _, row in rows])
    except ValueError as error:
        found = f"{path}: not a table of numbers ({clipped(error)})"
        raise PocketGSError(f"{found}, expected a 3x3 intrinsic matrix") from error
    if matrix.shape != (3, 3) or not np.all(np.isfinite(matrix)):
        raise PocketGSError(f"{path}: holds an array of shape {matrix.shape}, expected 3x3 finite numbers")
    return matrix


def _read_odometry(path: Path) -> dict[int, Odometry]:
    """Poses and intrinsics by number of the video frame, ascending."""
    rows = _read_rows(path)
    header = [name.lower() for name in rows[0][1]] if rows else []
    if not set(POSE_COLUMNS) <= set(header):
        raise PocketGSError(f"{path}: its first line is not a header with the columns {', '.join(POSE_COLUMNS)}")
    found: dict[int, Odometry] = {}
    for line, row in rows[1:]:
        where = f"{path}, line {line}"
        if len(row) != len(header):
            raise PocketGSError(f"{where}: holds {len(row)} values, expected {len(header)} as in the header")
        values = dict(zip(header, row, strict=True))
        index = _frame_number(values, where)
        if index in found:
            raise PocketGSError(f"{where}: a second pose of frame {index}, expected one")
        found[index] = Odometry(_pose(values, where), _intrinsics(values, where))
    return dict(sorted(found.items()))


def _frame_number(row: dict[str, str], where: str) -> int:
    index = _numbers(row, ("frame",), where)[0]
    if index < 0 or not index.is_integer():
        raise PocketGSError(f"{where}: frame {clipped(row['frame'])}, expected a whole number from 0")
    return int(index)


def _pose(row: dict[str, str], where: str) -> np.ndarray:
    """World to camera."""
    x, y, z, qx, qy, qz, qw = _numbers(row, POSE_COLUMNS[1:], where)
    # The app rotates ARKit's camera by 180 degrees about x before it writes the rotation from camera to world
    # (OdometryEncoder.swift, q_AC): the axes are already OpenCV's.
    axes = rotation_from_quaternion(np.array([qw, qx, qy, qz]), where)
    return world_to_camera_from_axes(axes, np.array([x, y, z]), where)


def _intrinsics(row: dict[str, str], where: str) -> tuple[float, ...] | None:
    """fx, fy, cx, cy, or None if the app's version does not state them per frame."""
    stated = all(row.get(name) for name in INTRINSIC_COLUMNS)
    return _numbers(row, INTRINSIC_COLUMNS, where) if stated else None


def _numbers(row: dict[str, str], names: Sequence[str], where: str) -> tuple[float, ...]:
    try:
        return tuple(float(row[name]) for name in names)
    except ValueError as error:
        raise PocketGSError(f"{where}: not a number where one is expected ({clipped(error)})") from error


def _read_rows(path: Path) -> list[tuple[int, list[str]]]:
    """The non-empty lines of a CSV file with their line numbers from 1."""
    try:
        lines = read_bytes(path).decode("utf-8-sig").splitlines()
        rows = [(number, next(csv.reader([line]))) for number, line in enumerate(lines, 1) if line.strip()]
    except (OSError, ValueError, csv.Error) as error:
        raise PocketGSError(f"{path}: not a readable CSV file in UTF-8 ({clipped(error)})") from error
    return [(number, [value.strip() for value in row]) for number, row in rows]
