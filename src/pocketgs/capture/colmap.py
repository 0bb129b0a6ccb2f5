"""COLMAP: a sparse model (cameras, images, points3D; binary or text) beside a folder of images."""

from __future__ import annotations

from pathlib import Path

from pocketgs.capture import colmap_files
from pocketgs.capture.colmap_model import ColmapCamera, ColmapImage
from pocketgs.capture.listing import FrameSource, Listing
from pocketgs.capture.paths import existing_file, inside, list_images, relative_name
from pocketgs.capture.poses import camera_at, rotation_from_quaternion, world_to_camera_of
from pocketgs.errors import PocketGSError

FORMAT = "colmap"
LOOKED_FOR = "cameras and images .bin or .txt, there or in sparse/0, sparse or colmap/sparse/0"
MODEL_FOLDERS = ("", "sparse/0", "sparse", "colmap/sparse/0")
DEFAULT_IMAGES = "images"


def recognises(path: Path) -> bool:
    """Whether a sparse model with cameras and images is there. LLFF captures have one without images."""
    return path.is_dir() and _model_folder(path) is not None


def read(path: Path, images: str | None = None) -> Listing:
    """Read the model.

    Args:
        path: the capture's folder.
        images: folder inside it with the image files, `images` if None.

    Raises:
        PocketGSError: a file is malformed, a camera model cannot be undone, or no registered image exists.
    """
    model = _model_folder(path)
    if model is None:
        raise PocketGSError(f"{path}: no COLMAP model, expected {LOOKED_FOR}")
    cameras = colmap_files.read_cameras(model)
    registered = colmap_files.read_images(model)
    if not registered:
        raise PocketGSError(f"{model}: registers no image, expected at least one")
    image_folder = inside(path, images or DEFAULT_IMAGES, "the images option")
    if not image_folder.is_dir():
        raise PocketGSError(f"{image_folder}: no such folder, expected the images that the COLMAP model registers")
    files, warnings = _match_files(registered, image_folder, path, f"{model}: images")
    frames = [
        _frame(image, file, path, cameras, f"{model}, image {image.name}")
        for image, file in zip(registered, files, strict=True)
        if file is not None
    ]
    return Listing(FORMAT, frames, points=colmap_files.read_points(model), warnings=warnings)


def _model_folder(path: Path) -> Path | None:
    folders = (path / name for name in MODEL_FOLDERS)
    parts = ("cameras", "images")
    return next((f for f in folders if all(colmap_files.find_part(f, part) for part in parts)), None)


def _match_files(
    registered: list[ColmapImage], image_folder: Path, capture: Path, where: str
) -> tuple[list[Path | None], tuple[str, ...]]:
    """Each registered image's file, None where it is absent, and what to warn of."""
    files = [existing_file(image_folder, image.name, where) for image in registered]
    absent = [image.name for image, file in zip(registered, files, strict=True) if file is None]
    if not absent:
        return files, ()
    if len(absent) < len(registered):
        return files, (f"{len(absent)} of {len(registered)} registered images are absent, the first {absent[0]}",)
    # Downscaled copies are often renamed (LLFF: images/IMG_4026.JPG, images_8/image000.png) but keep their order.
    renamed = list_images(image_folder)
    if len(renamed) != len(registered):
        raise PocketGSError(
            f"{image_folder}: holds none of the {len(registered)} registered images, such as {absent[0]}"
        )
    by_name = dict(zip(sorted(image.name for image in registered), renamed, strict=True))
    message = f"{relative_name(image_folder, capture)} names its files otherwise: matched to the model in sorted order"
    return [by_name[image.name] for image in registered], (message,)


def _frame(image: ColmapImage, file: Path, capture: Path, cameras: dict[int, ColmapCamera], where: str) -> FrameSource:
    camera = cameras.get(image.camera_id)
    if camera is None:
        raise PocketGSError(f"{where}: taken by camera {image.camera_id}, expected one of {sorted(cameras)[:10]}")
    pose = world_to_camera_of(rotation_from_quaternion(image.quaternion, where), image.translation, where)
    size = (camera.width, camera.height)
    return FrameSource(
        relative_name(file, capture), file, camera_at(where, size, camera.focal, camera.centre, pose), camera.lens
    )
