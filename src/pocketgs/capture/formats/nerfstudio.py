"""Reader of nerfstudio, instant-ngp and NeRFCapture captures: one transforms.json beside its images."""

from __future__ import annotations

from pathlib import Path, PureWindowsPath

from pocketgs.capture.decoding.cloud_file import read_cloud
from pocketgs.capture.formats.stated_intrinsics import NERFCAPTURE_FIELD
from pocketgs.capture.formats.transforms_file import (
    absent_warning,
    check_some_exist,
    depth_warning,
    held_out_too_warning,
    mask_warning,
    read_frames,
)
from pocketgs.capture.listing import FrameSource, Listing
from pocketgs.capture.named_images import find_moved, spelling
from pocketgs.capture.unposed import few_posed
from pocketgs.files.json_fields import Fields, read_json
from pocketgs.scene.point_cloud import PointCloud

FORMAT = "nerfstudio"
LOOKED_FOR = "transforms.json"
PARTS = ("train_filenames", "val_filenames", "test_filenames")


def recognises(path: Path) -> bool:
    """Whether the path is a JSON file or a folder with a transforms.json."""
    return (path.is_file() and path.suffix.lower() == ".json") or (path / "transforms.json").is_file()


def read(path: Path, images: str | None = None) -> Listing:
    """Read the frames, the split if there is one, and the cloud that `ply_file_path` names.

    The poses and the cloud share one coordinate frame; `applied_transform` relates it to the original data and is not
    needed.

    Args:
        path: the folder or the file.
        images: folder inside the capture to take the images from, see `read_frames`.

    Raises:
        PocketGSError: a field is missing or malformed, a path leaves the folder, or no frame has an image.
    """
    file = path if path.is_file() else path / "transforms.json"
    document = read_json(file)
    listed, warnings = read_frames(document, file.parent, images)
    check_some_exist(listed, document)
    warnings += _few_posed_warning(listed, file)
    warnings += absent_warning(listed, document) + mask_warning(listed, document) + depth_warning(listed, document)
    frames, held_out = _split(document, listed)
    points, more_warnings = _cloud(document, file.parent)
    warnings += _split_warnings(document) + more_warnings
    # ARKit's poses are in metres.
    metric = NERFCAPTURE_FIELD in document.values or document.flag("metric")
    return Listing(FORMAT, frames, held_out=held_out, points=points, metric=metric, warnings=warnings)


def _few_posed_warning(listed: list[FrameSource | None], file: Path) -> tuple[str, ...]:
    """A warning if most photographs have no pose, or no warning.

    Other files than `transforms.json` are often one of several. Recordings with depth have the phone's own poses, which
    need not be found anew.
    """
    frames = [frame for frame in listed if frame]
    if file.name != LOOKED_FOR or any(frame.depth_path for frame in frames):
        return ()
    return few_posed([frame.image for frame in frames], [frame.mask_path for frame in frames], file.parent, file.name)


def _split(document: Fields, listed: list[FrameSource | None]) -> tuple[list[FrameSource], frozenset[str] | None]:
    """The frames to use and the names of the held-out ones, by the file's own split.

    The test frames are held out, or the validation frames if there are no test frames, even where they are listed for
    training too. Frames outside the split, and validation frames beside test frames, are not used.
    """
    present = [frame for frame in listed if frame is not None]
    train, val, test = (_part(document, listed, name) for name in PARTS)
    held_out = test or val
    train = train or frozenset(frame.name for frame in present) - val - held_out
    return [frame for frame in present if frame.name in train | held_out], held_out or None


def _part(document: Fields, listed: list[FrameSource | None], name: str) -> frozenset[str]:
    """Names of the existing frames in a list of file paths; none if there is no such list."""
    wanted = {_key(path) for path in document.optional_texts(name) or ()}
    frames = zip(document.objects("frames"), listed, strict=True)
    return frozenset(f.name for fields, f in frames if f and _key(fields.text("file_path")) in wanted)


def _split_warnings(document: Fields) -> tuple[str, ...]:
    """Warnings about lists of the split that name no frames, whether or not their images exist, or the same ones."""
    stated = {_key(fields.text("file_path")) for fields in document.objects("frames")}
    lists = {name: document.optional_texts(name) or [] for name in PARTS}
    unknown = {name: [path for path in paths if _key(path) not in stated] for name, paths in lists.items()}
    warnings = (
        f"{document.where}: {len(paths)} of {len(lists[name])} paths in {name} are no file_path of a frame: correct "
        f"them, the first {paths[0]}"
        for name, paths in unknown.items()
        if paths
    )
    return (*warnings, *_overlap_warning(document, lists, stated))


def _overlap_warning(document: Fields, lists: dict[str, list[str]], stated: set[str]) -> tuple[str, ...]:
    """A warning if frames are both for training and held out, or none."""
    train, val, test = ([path for path in paths if _key(path) in stated] for paths in lists.values())
    held_out = set(map(_key, test or val))
    both = [path for path in train if _key(path) in held_out]
    return held_out_too_warning(document.where, both, len(train))


def _key(path: str) -> str:
    """A path without what differs between systems: its separator, case, and the encoding of accents."""
    return spelling(PureWindowsPath(path).as_posix())


def _cloud(document: Fields, folder: Path) -> tuple[PointCloud | None, tuple[str, ...]]:
    name = document.optional_text("ply_file_path")
    if name is None:
        return None, ()
    path = find_moved(folder, name, document.where)
    if path is None:
        return None, (f"{document.where}: the point cloud {name} is absent",)
    return read_cloud(path), ()
