"""Reader of nerfstudio, instant-ngp and NeRFCapture captures: one transforms.json beside its images."""

from __future__ import annotations

from pathlib import Path, PurePosixPath

from pocketgs.capture.cloud_file import read_cloud
from pocketgs.capture.formats.stated_intrinsics import NERFCAPTURE_FIELD
from pocketgs.capture.formats.transforms_file import absent_warning, depth_warning, mask_warning, read_frames
from pocketgs.capture.listing import FrameSource, Listing
from pocketgs.capture.named_images import find_moved
from pocketgs.errors import PocketGSError
from pocketgs.files.json_fields import Fields, read_json
from pocketgs.scene.point_cloud import PointCloud

FORMAT = "nerfstudio"
LOOKED_FOR = "transforms.json"


def recognises(path: Path) -> bool:
    """Whether the path is a JSON file or a folder with a transforms.json."""
    return (path.is_file() and path.suffix.lower() == ".json") or (path / "transforms.json").is_file()


def read(path: Path, images: str | None = None) -> Listing:
    """Read the frames, the split if there is one, and the cloud that `ply_file_path` names.

    The poses and the cloud share one coordinate frame; `applied_transform` relates it to the original data and is not
    needed.

    Args:
        path: the folder or the file.
        images: folder inside the capture to take the images from, by file name.

    Raises:
        PocketGSError: a field is missing or malformed, a path leaves the folder, or no frame has an image.
    """
    file = path if path.is_file() else path / "transforms.json"
    document = read_json(file)
    listed, warnings = read_frames(document, file.parent, images)
    warnings += absent_warning(listed, document) + mask_warning(listed, document) + depth_warning(listed, document)
    if listed and all(frame is None for frame in listed):
        raise PocketGSError(f"{file}: none of the {len(listed)} listed frames has an image file")
    frames, held_out = _split(document, listed)
    points, more_warnings = _cloud(document, file.parent)
    # ARKit's poses are in metres.
    metric = NERFCAPTURE_FIELD in document.values or document.flag("metric")
    return Listing(FORMAT, frames, held_out=held_out, points=points, metric=metric, warnings=warnings + more_warnings)


def _split(document: Fields, listed: list[FrameSource | None]) -> tuple[list[FrameSource], frozenset[str] | None]:
    """The frames to use and the names of the held-out ones, by the file's own split.

    The test frames are held out, or the validation frames if there are no test frames. Frames outside the split, and
    validation frames beside test frames, are not used.
    """
    present = [frame for frame in listed if frame is not None]
    parts = {name: _part(document, listed, f"{name}_filenames") for name in ("train", "val", "test")}
    held_out = parts["test"] or parts["val"]
    if not held_out:
        return present, None
    train = parts["train"] or frozenset(f.name for f in present) - (parts["val"] or frozenset()) - held_out
    if train & held_out:
        raise PocketGSError(f"{document.where}: the image {min(train & held_out)} is both for training and held out")
    return [frame for frame in present if frame.name in train | held_out], held_out


def _part(document: Fields, listed: list[FrameSource | None], name: str) -> frozenset[str] | None:
    """Names of the existing frames in a list of file paths, or None if there is no such list."""
    paths = document.optional_texts(name)
    if paths is None:
        return None
    wanted = {PurePosixPath(path) for path in paths}
    frames = zip(document.objects("frames"), listed, strict=True)
    return frozenset(f.name for fields, f in frames if f and PurePosixPath(fields.text("file_path")) in wanted)


def _cloud(document: Fields, folder: Path) -> tuple[PointCloud | None, tuple[str, ...]]:
    name = document.optional_text("ply_file_path")
    if name is None:
        return None, ()
    path = find_moved(folder, name, document.where)
    if path is None:
        return None, (f"{document.where}: the point cloud {name} is absent",)
    return read_cloud(path), ()
