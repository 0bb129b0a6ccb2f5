"""Reader of COLMAP captures: a sparse model (cameras, images, points3D; binary or text) and a folder of images."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

from pocketgs.capture.formats import colmap_files
from pocketgs.capture.formats.colmap_images import holds_any, match_files
from pocketgs.capture.formats.colmap_model import ColmapCamera, ColmapImage
from pocketgs.capture.listing import FrameSource, Listing
from pocketgs.capture.poses import camera_at, rotation_from_quaternion, world_to_camera_of
from pocketgs.capture.unposed import POSED_RECORD, USUAL_FOLDER
from pocketgs.errors import PocketGSError
from pocketgs.files.paths import inside, relative_name

FORMAT = "colmap"
LOOKED_FOR = "cameras and images .bin or .txt, there or in sparse/0, sparse, colmap/sparse or dense/sparse"
MODEL_FOLDERS = ("", "sparse/0", "sparse", "colmap/sparse/0", "colmap/sparse", "dense/sparse", "dense/0/sparse")
IMAGE_FOLDERS = (USUAL_FOLDER, "images_2", "images_4", "images_8", "rgb", "input", "photos")
MODELS_BESIDE = ("", "sparse/0", "sparse")
"""Places of a model beside its own folder of images."""


@dataclass(frozen=True)
class _Model:
    """A sparse model, and warnings about its choice."""

    folder: Path
    images: list[ColmapImage]
    warnings: tuple[str, ...] = ()

    @property
    def names(self) -> list[str]:
        return [image.name for image in self.images]


def recognises(path: Path) -> bool:
    """Whether the folder has a sparse model with cameras and images. LLFF captures have one without images."""
    return path.is_dir() and any(_models_at(path, name) for name in MODEL_FOLDERS)


def read(path: Path, images: str | None = None) -> Listing:
    """Read the model.

    Args:
        path: the capture's folder.
        images: folder inside it with the image files; if None, a usual one beside the model or else in the capture.

    Raises:
        PocketGSError: a file is malformed, a camera model is not supported, or no registered image exists.
    """
    model = _choose_model(path, images)
    cameras = colmap_files.read_cameras(model.folder, {image.camera_id for image in model.images})
    if not model.images:
        raise PocketGSError(f"{model.folder}: registers no image, expected at least one")
    around, folder = _folder_around(model.folder, path), _image_folder(path, model.folder, images)

    def is_of_another_model(place: Path) -> bool:
        return not place.parent.samefile(around) and any(_models_at(place.parent, name) for name in MODELS_BESIDE)

    leave_out = is_of_another_model if images is None else None
    files, warnings = match_files(model.names, folder, path, f"{model.folder}: images", leave_out)
    frames = [
        _frame(image, file, path, cameras, f"{model.folder}, image {image.name}")
        for image, file in zip(model.images, files, strict=True)
        if file is not None
    ]
    points = colmap_files.read_points(model.folder)
    return Listing(FORMAT, frames, points=points, metric=_is_metric(path), warnings=model.warnings + warnings)


def _is_metric(path: Path) -> bool:
    """Whether lengths are metres, which only captures made by this package state."""
    try:
        return json.loads((path / POSED_RECORD).read_text(encoding="utf-8")).get("metric") is True
    except (OSError, ValueError, AttributeError, RecursionError):
        return False


def _choose_model(path: Path, images: str | None) -> _Model:
    """The first model whose own image folder is used or holds its images, or else the first.

    COLMAP writes undistorted images beside a model of their own, and the originals may be elsewhere.

    Raises:
        PocketGSError: there is no model, or one that is looked at is malformed.
    """
    places = [folders for name in MODEL_FOLDERS if (folders := _models_at(path, name))]
    if not places:
        raise PocketGSError(f"{path}: no COLMAP model, expected {LOOKED_FOR}")
    first = _largest(places[0], path)
    others = (_largest(folders, path) for folders in places[1:])
    return next((model for model in chain([first], others) if _has_images(model, path, images)), first)


def _models_at(path: Path, name: str) -> list[Path]:
    """The complete models at a place of `MODEL_FOLDERS`: where its name holds a 0, all that COLMAP numbers like it."""
    before, zero, after = name.partition("0")
    folders = [path / name]
    if zero:
        inner = (path / before).iterdir() if (path / before).is_dir() else ()
        numbers = sorted({int(folder.name) for folder in inner if re.fullmatch("[0-9]{1,9}", folder.name)})
        folders = [path / f"{before}{number}{after}" for number in numbers]
    parts = ("cameras", "images")
    return [folder for folder in folders if all(colmap_files.find_part(folder, part) for part in parts)]


def _largest(folders: list[Path], capture: Path) -> _Model:
    """Of several models, whose worlds have nothing in common, the one with the most registered images."""
    models = [_Model(folder, colmap_files.read_images(folder)) for folder in folders]
    largest = max(models, key=lambda model: len(model.images))
    if len(models) == 1:
        return largest
    sizes = [f"{relative_name(model.folder, capture)} with {len(model.images)}" for model in models]
    found = f"{len(models)} COLMAP models that do not fit together: {', '.join(sizes)} images"
    return replace(largest, warnings=(f"{found}; only the largest, {sizes[models.index(largest)]}, is used",))


def _has_images(model: _Model, capture: Path, images: str | None) -> bool:
    around = _folder_around(model.folder, capture)
    if images is not None:
        folder = inside(capture, images, "the images option")
        return folder.is_dir() and folder.parent.samefile(around)
    usual = next((around / name for name in IMAGE_FOLDERS if (around / name).is_dir()), None)
    return usual is not None and holds_any(usual, model.names, str(model.folder))


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
    """The folder that holds a model's `sparse` or `sparse/0`, whatever its number."""
    sparse = model.parent if model.name.isdigit() else model
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
