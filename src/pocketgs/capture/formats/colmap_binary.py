"""Reader of COLMAP's binary models: cameras.bin, images.bin, points3D.bin (little-endian, counts first)."""

from __future__ import annotations

import struct
from collections.abc import Collection
from pathlib import Path

import numpy as np

from pocketgs.capture.formats.colmap_model import (
    CAMERA_MODELS,
    UNSUPPORTED_MODELS,
    ColmapCamera,
    ColmapImage,
    camera_from_parameters,
    unknown_model,
)
from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import require_memory
from pocketgs.files.opening import read_bytes
from pocketgs.scene.point_cloud import PointCloud

CAMERA_HEADER = struct.Struct("<iiQQ")
IMAGE_HEADER = struct.Struct("<I7dI")
COUNT = struct.Struct("<Q")
POINT_2D_BYTES = 24
TRACK_ELEMENT_BYTES = 8
POINT_BYTES = 80
"""Memory per point of a cloud, while it is read and checked, besides the file's bytes."""

POINTS_AT_ONCE = 1 << 14
# A point: id (8), position (24), colour (3), error (8), then the length of its track.
POSITION_OFFSET, COLOUR_OFFSET, TRACK_OFFSET = 8, 32, 43

WHOLE = ": was it copied as a whole?"
"""Ends messages about files that end early."""


class _Cursor:
    """Reads a file's bytes in order; raises PocketGSError at a premature end."""

    def __init__(self, path: Path) -> None:
        try:
            self.data = read_bytes(path)
        except OSError as error:
            raise PocketGSError(f"{path}: cannot be read ({error.strerror})") from error
        self.path = path
        self.offset = 0

    def unpack(self, layout: struct.Struct) -> tuple:
        start = self.skip(layout.size)
        return layout.unpack_from(self.data, start)

    def skip(self, size: int) -> int:
        """Skip `size` bytes; returns their offset."""
        start = self.offset
        if start + size > len(self.data):
            raise self.truncated()
        self.offset = start + size
        return start

    def count(self, smallest_item: int) -> int:
        """Read a count, and check that the rest of the file can hold as many items."""
        (number,) = self.unpack(COUNT)
        if number > (len(self.data) - self.offset) // smallest_item:
            held = f"more than its {len(self.data)} bytes can hold"
            raise PocketGSError(f"{self.path}: states {number} items, {held}{WHOLE}")
        return int(number)

    def text(self) -> str:
        """Read a zero-terminated string."""
        end = self.data.find(b"\0", self.offset)
        if end < 0:
            raise self.truncated()
        start = self.skip(end + 1 - self.offset)
        try:
            return self.data[start:end].decode("utf-8")
        except UnicodeDecodeError as error:
            raise PocketGSError(f"{self.path}: an image name at byte {start} is not UTF-8") from error

    def truncated(self) -> PocketGSError:
        return PocketGSError(f"{self.path}: ends after {len(self.data)} bytes, in the middle of an item{WHOLE}")


def read_cameras(path: Path, used: Collection[int] | None = None) -> dict[int, ColmapCamera]:
    """Read a cameras.bin: cameras by id.

    Args:
        path: of the file.
        used: ids of the cameras that must be read, None for all. Others are left out if their model is not supported.

    Raises:
        PocketGSError: the file is truncated, or the model of a used camera is not supported, or that of any is unknown.
    """
    cursor = _Cursor(path)
    cameras = {}
    for _ in range(cursor.count(CAMERA_HEADER.size)):
        camera_id, model_id, width, height = cursor.unpack(CAMERA_HEADER)
        where = f"{path}, camera {camera_id}"
        model = CAMERA_MODELS.get(model_id)
        if model is None and used is not None and camera_id not in used and model_id in UNSUPPORTED_MODELS:
            cursor.skip(8 * UNSUPPORTED_MODELS[model_id])
            continue
        if model is None:
            raise unknown_model(where, f"number {model_id}")
        values = cursor.unpack(struct.Struct(f"<{len(model.parameters)}d"))
        cameras[camera_id] = camera_from_parameters(model, width, height, list(values), where)
    return cameras


def read_images(path: Path) -> list[ColmapImage]:
    """Read the registered images of an images.bin.

    Raises:
        PocketGSError: the file is truncated, or a name is not UTF-8.
    """
    cursor = _Cursor(path)
    images = []
    for _ in range(cursor.count(IMAGE_HEADER.size + 1 + COUNT.size)):
        _, *pose, camera_id = cursor.unpack(IMAGE_HEADER)
        name = cursor.text()
        cursor.skip(cursor.count(POINT_2D_BYTES) * POINT_2D_BYTES)
        images.append(ColmapImage(name, camera_id, np.array(pose[:4]), np.array(pose[4:])))
    return images


def read_points(path: Path) -> PointCloud:
    """Read the cloud of a points3D.bin.

    Raises:
        PocketGSError: the file is truncated, or exceeds the memory bound.
    """
    cursor = _Cursor(path)
    count = cursor.count(TRACK_OFFSET + COUNT.size)
    require_memory(path, len(cursor.data) + POINT_BYTES * count, f"a cloud of {count:,} points")
    # Tracks make the records differ in length, so finding their starts needs a loop.
    starts = np.empty(count, dtype=np.int64)
    data, offset, smallest = cursor.data, cursor.offset, TRACK_OFFSET + COUNT.size
    unpack_track_length = COUNT.unpack_from
    last_start = len(data) - smallest
    for index in range(count):
        if offset > last_start:
            raise cursor.truncated()
        starts[index] = offset
        (track_length,) = unpack_track_length(data, offset + TRACK_OFFSET)
        offset += smallest + track_length * TRACK_ELEMENT_BYTES
    if offset > len(data):
        raise cursor.truncated()
    raw = np.frombuffer(data, dtype=np.uint8)
    positions, colours = np.empty((count, 3)), np.empty((count, 3), np.float32)
    for first in range(0, count, POINTS_AT_ONCE):  # the places of all bytes at once would take four times the file
        some = slice(first, first + POINTS_AT_ONCE)
        places = starts[some, None]
        positions[some] = raw[places + np.arange(POSITION_OFFSET, COLOUR_OFFSET)].view("<f8")
        colours[some] = raw[places + np.arange(COLOUR_OFFSET, COLOUR_OFFSET + 3)] / 255.0
    return PointCloud(positions, colours)
