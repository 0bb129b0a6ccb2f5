"""The three files of a COLMAP sparse model, binary or text."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np

from pocketgs.capture.formats import colmap_binary, colmap_text
from pocketgs.capture.formats.colmap_model import ColmapCamera, ColmapImage
from pocketgs.capture.poses import MAX_COORDINATE
from pocketgs.errors import PocketGSError
from pocketgs.scene.point_cloud import PointCloud


def find_part(folder: Path, part: str) -> Path | None:
    """The file of "cameras", "images" or "points3D" in a model's folder; the binary one if both exist."""
    candidates = (folder / f"{part}.bin", folder / f"{part}.txt")
    return next((path for path in candidates if path.is_file()), None)


def read_cameras(folder: Path, used: Collection[int] | None = None) -> dict[int, ColmapCamera]:
    """Read the model's cameras by id; empty if the folder has no such file.

    Args:
        folder: of the model.
        used: ids of the cameras that must be read, None for all. Others are left out if their model is not supported.

    Raises:
        PocketGSError: the file is malformed.
    """
    path = find_part(folder, "cameras")
    if path is None:
        return {}
    return (colmap_binary if path.suffix == ".bin" else colmap_text).read_cameras(path, used)


def read_images(folder: Path) -> list[ColmapImage]:
    """Read the model's registered images; empty if the folder has no such file.

    Raises:
        PocketGSError: the file is malformed.
    """
    path = find_part(folder, "images")
    if path is None:
        return []
    return (colmap_binary if path.suffix == ".bin" else colmap_text).read_images(path)


def read_points(folder: Path) -> PointCloud | None:
    """Read the model's cloud; None if the folder has none or it is empty.

    Raises:
        PocketGSError: the file is malformed, or a coordinate is not finite or too large.
    """
    path = find_part(folder, "points3D")
    if path is None:
        return None
    with np.errstate(over="ignore"):
        cloud = (colmap_binary if path.suffix == ".bin" else colmap_text).read_points(path)
    if not np.all(np.abs(cloud.positions) < MAX_COORDINATE) or not np.all(np.isfinite(cloud.colours)):
        raise PocketGSError(f"{path}: holds NaN or coordinates beyond {MAX_COORDINATE:g}")
    return cloud if len(cloud) else None
