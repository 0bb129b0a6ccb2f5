"""Reader of COLMAP's text models: cameras.txt, images.txt, points3D.txt (lines that begin with # are comments)."""

from __future__ import annotations

from array import array
from collections.abc import Collection, Iterator
from io import BytesIO, TextIOWrapper
from pathlib import Path

import numpy as np

from pocketgs.capture.formats.colmap_model import (
    CAMERA_MODELS,
    ColmapCamera,
    ColmapImage,
    camera_from_parameters,
    unknown_model,
)
from pocketgs.errors import PocketGSError, clipped
from pocketgs.files.memory_bound import require_memory
from pocketgs.files.opening import read_bytes
from pocketgs.scene.point_cloud import PointCloud

ROW_BYTES = 112
"""Bytes that a line of a point takes while it is read: its numbers, their array as it grows, and the cloud."""

MODELS_BY_NAME = {model.name: model for model in CAMERA_MODELS.values()}


def read_cameras(path: Path, used: Collection[int] | None = None) -> dict[int, ColmapCamera]:
    """Read a cameras.txt, cameras by id: CAMERA_ID MODEL WIDTH HEIGHT PARAMETERS….

    Args:
        path: of the file.
        used: ids of the cameras that must be read, None for all. Others are left out if their model is not supported.

    Raises:
        PocketGSError: a line is malformed, or the model of a used camera is not supported.
    """
    cameras = {}
    for where, line in _content(_lines(path)):
        words = line.split()
        if len(words) < 4:
            raise _malformed(where, line, "CAMERA_ID MODEL WIDTH HEIGHT PARAMETERS")
        model = MODELS_BY_NAME.get(words[1])
        camera_id, width, height = _integers([words[0], words[2], words[3]], where)
        if model is None:
            if used is not None and camera_id not in used:
                continue
            raise unknown_model(where, words[1])
        values = _numbers(words[4:], where)
        if len(values) != len(model.parameters):
            raise _malformed(where, line, f"{len(model.parameters)} parameters for {model.name}")
        cameras[camera_id] = camera_from_parameters(model, width, height, values, where)
    return cameras


def read_images(path: Path) -> list[ColmapImage]:
    """Read the registered images of an images.txt, two lines each.

    The first is IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, the second lists the image's points and may be empty.
    Other programs leave the second out.

    Raises:
        PocketGSError: a line is malformed.
    """
    images: list[ColmapImage] = []
    is_second = False
    for where, line in _lines(path):
        if is_second and not _is_of_an_image(line):
            is_second = False
            continue
        if not _is_content(line):
            continue
        words = line.split(maxsplit=9)
        if len(words) < 10:
            raise _malformed(where, line, "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME")
        pose = np.array(_numbers(words[1:8], where))
        (camera_id,) = _integers([words[8]], where)
        images.append(ColmapImage(words[9], camera_id, pose[:4], pose[4:]))
        is_second = True
    return images


def _is_of_an_image(line: str) -> bool:
    """Whether a line ends in a name, such as `20240100 120000.jpg`. One that lists points ends in numbers."""
    words = line.split(maxsplit=9)
    if len(words) < 10:
        return False
    name = words[9].split(maxsplit=1)
    try:
        float(name[0])
        float(name[-1].rsplit(maxsplit=1)[-1])
    except ValueError:
        return True
    return False


def read_points(path: Path) -> PointCloud:
    """Read the cloud of a points3D.txt: POINT_ID X Y Z R G B ERROR TRACK….

    Raises:
        PocketGSError: a line is malformed.
    """
    rows = array("d")  # lists of numbers would take several times the file's size
    for where, line in _content(_lines(path)):
        words = line.split(maxsplit=7)
        if len(words) < 7:
            raise _malformed(where, line, "POINT_ID X Y Z R G B ERROR TRACK")
        rows.extend(_numbers(words[1:7], where))
    table = np.frombuffer(rows, dtype=np.float64).reshape(-1, 6)
    return PointCloud(table[:, :3], table[:, 3:] / 255)


def _lines(path: Path) -> Iterator[tuple[str, str]]:
    """Every line with its position, for error messages."""
    try:
        content = read_bytes(path)
        require_memory(path, len(content) + ROW_BYTES * content.count(b"\n"), f"its {len(content):,} bytes of text")
        for number, line in enumerate(TextIOWrapper(BytesIO(content), "utf-8-sig", newline="\n"), start=1):
            yield f"{path}, line {number}", line.strip()
    except OSError as error:
        raise PocketGSError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise PocketGSError(f"{path}: not UTF-8 text ({error})") from error


def _content(lines: Iterator[tuple[str, str]]) -> Iterator[tuple[str, str]]:
    return ((where, line) for where, line in lines if _is_content(line))


def _is_content(line: str) -> bool:
    return bool(line) and not line.startswith("#")


def _numbers(words: list[str], where: str) -> list[float]:
    try:
        return [float(word) for word in words]
    except ValueError as error:
        raise PocketGSError(f"{where}: {clipped(error)}, expected numbers") from error


def _integers(words: list[str], where: str) -> list[int]:
    try:
        return [int(word) for word in words]
    except ValueError as error:
        raise PocketGSError(f"{where}: {clipped(error)}, expected whole numbers") from error


def _malformed(where: str, line: str, expected: str) -> PocketGSError:
    return PocketGSError(f"{where}: found {line[:80]!r}, expected {expected}")
