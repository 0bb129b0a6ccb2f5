"""Reader of COLMAP captures: a sparse model (cameras, images, points3D; binary or text) and a folder of images."""

from __future__ import annotations

import json
from pathlib import Path

from pocketgs.capture.formats import colmap_files
from pocketgs.capture.formats.colmap_model import ColmapCamera, ColmapImage
from pocketgs.capture.listing import FrameSource, Listing
from pocketgs.capture.named_images import find_images, find_stated
from pocketgs.capture.poses import camera_at, rotation_from_quaternion, world_to_camera_of
from pocketgs.errors import PocketGSError
from pocketgs.files.paths import inside, list_images, relative_name

FORMAT = "colmap"
LOOKED_FOR = "cameras and images .bin or .txt, there or in sparse/0, sparse, colmap/sparse or dense/sparse"
MODEL_FOLDERS = ("", "sparse/0", "sparse", "colmap/sparse/0", "colmap/sparse", "dense/sparse", "dense/0/sparse")
DEFAULT_IMAGES = "images"
IMAGE_FOLDERS = (DEFAULT_IMAGES, "images_2", "images_4", "images_8", "rgb", "input", "photos")
POSED_RECORD = "posed.json"
"""Name of the record of how this package has found a capture's poses."""


def recognises(path: Path) -> bool:
    """Whether the folder has a sparse model with cameras and images. LLFF captures have one without images."""
    return path.is_dir() and _model_folder(path) is not None


def read(path: Path, images: str | None = None) -> Listing:
    """Read the model.

    Args:
        path: the capture's folder.
        images: folder inside it with the image files; if None, a usual one beside the model or else in the capture.

    Raises:
        PocketGSError: a file is malformed, a camera model is not supported, or no registered image exists.
    """
    model = _model_folder(path)
    if model is None:
        raise PocketGSError(f"{path}: no COLMAP model, expected {LOOKED_FOR}")
    cameras = colmap_files.read_cameras(model)
    registered = colmap_files.read_images(model)
    if not registered:
        raise PocketGSError(f"{model}: registers no image, expected at least one")
    files, warnings = _match_files(registered, path, model, images)
    frames = [
        _frame(image, file, path, cameras, f"{model}, image {image.name}")
        for image, file in zip(registered, files, strict=True)
        if file is not None
    ]
    points = colmap_files.read_points(model)
    return Listing(FORMAT, frames, points=points, metric=_is_metric(path), warnings=warnings)


def _is_metric(path: Path) -> bool:
    """Whether lengths are metres, which only captures made by this package state."""
    try:
        return json.loads((path / POSED_RECORD).read_text(encoding="utf-8")).get("metric") is True
    except (OSError, ValueError, AttributeError, RecursionError):
        return False


def _model_folder(path: Path) -> Path | None:
    folders = (path / name for name in MODEL_FOLDERS)
    parts = ("cameras", "images")
    return next((f for f in folders if all(colmap_files.find_part(f, part) for part in parts)), None)


def _match_files(
    registered: list[ColmapImage], capture: Path, model: Path, images: str | None
) -> tuple[list[Path | None], tuple[str, ...]]:
    """Each registered image's file, None where it is missing, and warnings."""
    folder = _image_folder(capture, model, images)
    where = f"{model}: images"
    names = [image.name for image in registered]
    warnings: tuple[str, ...] = ()
    # Absolute paths are of the machine that wrote them: those images are found by name alone.
    were_elsewhere = images is None and any(Path(name).is_absolute() for name in names)
    files: list[Path | None] = [] if were_elsewhere else find_stated(folder, names, where)
    if images is None and not any(files):
        # As with relative names, those of the folder beside the model come first: the originals have the same names.
        below = [f"{DEFAULT_IMAGES}/{name}" for name in names]
        for place in dict.fromkeys((folder, capture) if were_elsewhere else (capture,)):
            files, warnings = find_images(place, below, where)
            if any(files):
                break
    absent = [name for name, file in zip(names, files, strict=True) if file is None]
    if not absent:
        return files, warnings
    if len(absent) < len(names):
        found = f"{len(absent)} of {len(names)} registered images are absent, the first {absent[0]}"
        return files, (*warnings, found)
    # Downscaled copies are often renamed (LLFF: images/IMG_4026.JPG, images_8/image000.png) but stay in order.
    renamed = list_images(folder)
    if len(renamed) != len(names):
        raise PocketGSError(f"{folder}: holds none of the {len(names)} registered images, such as {absent[0]}")
    by_name = dict(zip(sorted(names), renamed, strict=True))
    message = f"{relative_name(folder, capture)} names its files otherwise: matched to the model in sorted order"
    return [by_name[name] for name in names], (message,)


def _image_folder(capture: Path, model: Path, images: str | None) -> Path:
    """The requested folder, or the first usual one that exists beside the model or in the capture, or the capture.

    COLMAP writes undistorted images beside their model; the originals in the capture have the same names.

    Raises:
        PocketGSError: the requested folder does not exist.
    """
    if images is not None:
        folder = inside(capture, images, "the images option")
        if not folder.is_dir():
            raise PocketGSError(f"{folder}: no such folder, expected the images that the COLMAP model registers")
        return folder
    places = dict.fromkeys((_folder_around(model, capture), capture))
    names = (relative_name(place / name, capture) for place in places for name in IMAGE_FOLDERS)
    usual = (inside(capture, name, "COLMAP capture") for name in names)
    return next((folder for folder in usual if folder.is_dir()), capture)


def _folder_around(model: Path, capture: Path) -> Path:
    """The folder that holds a model's `sparse` or `sparse/0`."""
    sparse = model.parent if model.name == "0" else model
    return capture if model == capture else sparse.parent


def _frame(image: ColmapImage, file: Path, capture: Path, cameras: dict[int, ColmapCamera], where: str) -> FrameSource:
    camera = cameras.get(image.camera_id)
    if camera is None:
        raise PocketGSError(f"{where}: taken by camera {image.camera_id}, expected one of {sorted(cameras)[:10]}")
    pose = world_to_camera_of(rotation_from_quaternion(image.quaternion, where), image.translation, where)
    size = (camera.width, camera.height)
    return FrameSource(
        relative_name(file, capture), file, camera_at(where, size, camera.focal, camera.centre, pose), camera.lens
    )
