"""Reader of LLFF captures: poses_bounds.npy, folders of images, one per resolution, and often COLMAP's cloud."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pocketgs.capture.decoding.image_file import read_array
from pocketgs.capture.formats import colmap_files
from pocketgs.capture.listing import FrameSource, Listing
from pocketgs.capture.poses import camera_at, world_to_camera_from_axes
from pocketgs.errors import PocketGSError
from pocketgs.files.paths import inside, list_images, relative_name
from pocketgs.geometry.lens import PINHOLE, Lens

FORMAT = "llff"
LOOKED_FOR = "poses_bounds.npy"
IMAGE_FOLDERS = ("images", "images_2", "images_4", "images_8")
MODEL_FOLDER = "sparse/0"


def recognises(path: Path) -> bool:
    """Whether the folder holds a poses_bounds.npy."""
    return (path / "poses_bounds.npy").is_file()


def read(path: Path, images: str | None = None) -> Listing:
    """Read the poses and pair them with the images in sorted order.

    Args:
        path: the capture's folder.
        images: folder inside it with the image files; if None the first existing one of images, images_2, images_4,
            images_8.

    Raises:
        PocketGSError: the array is malformed, or the numbers of images and poses differ.
    """
    table_path = path / "poses_bounds.npy"
    table = _read_table(table_path)
    image_folder = _image_folder(path, images)
    files = list_images(image_folder)
    if len(files) != len(table):
        raise PocketGSError(
            f"{image_folder}: holds {len(files)} images, expected {len(table)}, one for each row of {table_path.name}"
        )
    lens = _lens(path / MODEL_FOLDER)
    frames = [
        _frame(file, path, row[:15].reshape(3, 5), lens, f"{table_path}, row {index}")
        for index, (file, row) in enumerate(zip(files, table, strict=True))
    ]
    return Listing(FORMAT, frames, points=colmap_files.read_points(path / MODEL_FOLDER))


def _read_table(path: Path) -> np.ndarray:
    table = read_array(path)
    if table.ndim != 2 or table.shape[1] != 17 or len(table) == 0 or table.dtype.kind != "f":
        raise PocketGSError(f"{path}: array of shape {table.shape}, type {table.dtype}, expected (N, 17) floats")
    return table.astype(np.float64)


def _image_folder(path: Path, images: str | None) -> Path:
    if images is not None:
        return inside(path, images, "the images option")
    for name in IMAGE_FOLDERS:
        if (path / name).is_dir():
            return inside(path, name, "LLFF capture")
    raise PocketGSError(f"{path}: no folder of images, expected one of {', '.join(IMAGE_FOLDERS)}")


def _lens(model: Path) -> Lens:
    """The lens of COLMAP's only camera; poses_bounds.npy has none, and cannot tell several cameras apart."""
    cameras = list(colmap_files.read_cameras(model).values())
    return cameras[0].lens if len(cameras) == 1 else PINHOLE


def _frame(file: Path, capture: Path, row: np.ndarray, lens: Lens, where: str) -> FrameSource:
    """Make a frame from its (3, 5) row: axes [down, right, back], centre, then height, width, focal length."""
    down, right, back, centre, (height, width, focal) = row.T
    pose = world_to_camera_from_axes(np.stack([right, down, -back], axis=1), centre, where)
    camera = camera_at(where, (width, height), (focal, focal), (width / 2, height / 2), pose)
    return FrameSource(relative_name(file, capture), file, camera, lens)
