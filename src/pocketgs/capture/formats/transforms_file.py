"""Reader of transforms JSON files, the format that nerfstudio, instant-ngp and NeRF's Blender scenes share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path, PureWindowsPath

import numpy as np

from pocketgs.capture.decoding.image_file import read_size
from pocketgs.capture.formats.stated_intrinsics import (
    LENS_FIELDS,
    LENS_LIST,
    over_shared,
    read_intrinsics,
    states_pixels,
)
from pocketgs.capture.listing import FrameSource
from pocketgs.capture.named_images import find_images, find_moved, find_stated
from pocketgs.capture.poses import camera_at, world_to_camera_from_opengl
from pocketgs.errors import PocketGSError, short
from pocketgs.files.json_fields import Fields
from pocketgs.files.paths import inside, relative_name
from pocketgs.geometry.camera import Camera
from pocketgs.geometry.lens import PINHOLE, Lens

# Scenes rendered by Blender name their images without an extension.
EXTENSIONS_TRIED = ("", ".png", ".jpg", ".jpeg")
PERSPECTIVE_MODELS = ("PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV", "PERSPECTIVE")
FISHEYE_MODELS = ("OPENCV_FISHEYE",)
RATIONAL_MODEL = "FULL_OPENCV"
"""The model whose k4 to k6 are OpenCV's. In others k4 alone is the fourth term of Brown's polynomial."""

LISTED_COEFFICIENTS = ("k1", "k2", "k3", "k4", "p1", "p2")
"""What nerfstudio's `distortion_params` lists."""

KNOWN_MODELS = ", ".join(PERSPECTIVE_MODELS + FISHEYE_MODELS)
LENSES_OF_INSTANT_NGP = ("ftheta_p0", "equirectangular", "latlong", "orthographic")
"""Fields by which instant-ngp's files state a lens that is not supported."""
DEFAULT_DEPTH_UNIT = 0.001


def read_frames(
    document: Fields, folder: Path, images: str | None = None, may_have_moved: bool = True
) -> tuple[list[FrameSource | None], tuple[str, ...]]:
    """Read the frames in the listed order, None where an image file or a few poses are missing; returns warnings too.

    Intrinsics may be at the top level or in a frame; the frame's take precedence.

    Args:
        document: the whole file.
        folder: that its paths are relative to.
        images: folder to take the images from instead, by their paths below their first folder, or by file name.
        may_have_moved: if none is at its stated path, search the images in the whole folder by name.

    Raises:
        PocketGSError: a field is missing or malformed, or a path leaves the folder.
    """
    shared = Fields({name: value for name, value in document.values.items() if name != "frames"}, document.where)
    frames = [over_shared(frame, shared) for frame in document.objects("frames")]
    named = [frame.text("file_path") for frame in frames]
    warnings: tuple[str, ...] = ()
    if images is not None:
        files = _in_other_folder(folder, images, named, document.where)
    elif may_have_moved:
        files, warnings = find_images(folder, named, document.where, EXTENSIONS_TRIED)
    else:
        files = find_stated(folder, named, document.where, EXTENSIONS_TRIED)
    has_moved = images is not None
    may_lack_pose = 2 * sum(map(_lacks_pose, frames)) < len(frames)
    found: list[FrameSource | None] = []
    for frame, file in zip(frames, files, strict=True):
        if file is None or _is_mask_or_depth(file, frame, folder) or (may_lack_pose and _lacks_pose(frame)):
            found.append(None)
        else:
            found.append(_read_frame(frame, folder, file, has_moved))
    return found, warnings


def _lacks_pose(fields: Fields) -> bool:
    return fields.values.get("transform_matrix") is None


def _is_mask_or_depth(file: Path, fields: Fields, folder: Path) -> bool:
    """Whether a file of another suffix than a photograph's is its mask or depth map: these often have its stem."""
    if file.suffix.lower() == PureWindowsPath(fields.text("file_path")).suffix.lower():
        return False
    others = filter(None, (fields.optional_text("mask_path"), _read_depth(fields)[0]))
    found = (find_moved(folder, stated, fields.where) for stated in others)
    return any(other is not None and other.samefile(file) for other in found)


def check_some_exist(frames: list[FrameSource | None], document: Fields) -> None:
    """Refuse a file that lists no frame, or of whose frames none has an image.

    Raises:
        PocketGSError: it does.
    """
    if not frames:
        raise PocketGSError(f"{document.where}: lists no frame, expected at least one")
    if not any(frames):
        first = document.objects("frames")[0].text("file_path")
        raise PocketGSError(
            f"{document.where}: none of the {len(frames)} listed frames has an image file, the first {short(first)}"
        )


def absent_warning(frames: list[FrameSource | None], document: Fields) -> tuple[str, ...]:
    """Warnings that count the frames without an image file and those without a pose."""
    left_out = [fields for fields, frame in zip(document.objects("frames"), frames, strict=True) if frame is None]
    return tuple(
        f"{document.where}: {len(lacking)} of {len(frames)} listed frames have no {what}, the first "
        f"{lacking[0].text('file_path')}"
        for what, lacking in (
            ("image file", [fields for fields in left_out if not _lacks_pose(fields)]),
            ("pose", [fields for fields in left_out if _lacks_pose(fields)]),
        )
        if lacking
    )


def held_out_too_warning(where: object, both: Sequence[str], count: int) -> tuple[str, ...]:
    """A warning if photographs are both for training and held out, or none.

    Args:
        where: the file that holds them out.
        both: their names.
        count: number of photographs for training.
    """
    if not both:
        return ()
    found = f"{len(both)} of {count} images for training are held out too, the first {both[0]}"
    return (f"{where}: {found}: they are not trained on; --hold-out 0 trains on all",)


def depth_warning(frames: list[FrameSource | None], document: Fields) -> tuple[str, ...]:
    """A warning if depth maps are absent or lack a unit, or none: photographs alone are enough.

    Offline, the NeRFCapture app writes `depth_path` without `integer_depth_scale`; the files are then 8-bit pictures
    that hold no usable depth.
    """
    stated = [fields.over(document) for fields in document.objects("frames")]
    values = [fields.values for fields in stated]
    if any("depth_path" in f and "depth_file_path" not in f and "integer_depth_scale" not in f for f in values):
        return (f"{document.where}: its depth maps are left out, since no 'integer_depth_scale' states their unit",)
    named = [_read_depth(fields)[0] for fields in stated]
    return _without_file("depth maps", named, [frame is None or frame.depth_path for frame in frames], document)


def mask_warning(frames: list[FrameSource | None], document: Fields) -> tuple[str, ...]:
    """A warning if masks are absent, or none: frames without a mask are used whole."""
    named = [fields.over(document).optional_text("mask_path") for fields in document.objects("frames")]
    return _without_file("masks", named, [frame is None or frame.mask_path for frame in frames], document)


def _without_file(kind: str, named: Sequence[str | None], found: Sequence[object], document: Fields) -> tuple[str, ...]:
    """A warning if files of some kind are named, but not found, or none."""
    absent = [name for name, file in zip(named, found, strict=True) if name is not None and not file]
    if not absent:
        return ()
    return (f"{document.where}: {len(absent)} of its {kind} have no file where it states, the first {absent[0]}",)


def _in_other_folder(folder: Path, images: str, named: Sequence[str], where: str) -> list[Path | None]:
    """The files in the folder `images`, whose sub-folders are those of the stated first folder, or are none."""
    place = inside(folder, images, "the images option")
    if not place.is_dir():
        raise PocketGSError(f"{place}: no such folder, expected one with the images that {where} lists")
    paths = [PureWindowsPath(name) for name in named]  # with either separator
    below = ["/".join(part for part in path.parts[1:] if part != "..") or path.name for path in paths]
    mirrored = find_stated(folder, [f"{images}/{name}" for name in below], where, EXTENSIONS_TRIED)
    flat = find_stated(folder, [f"{images}/{path.name}" for path in paths], where, EXTENSIONS_TRIED)
    return [one or other for one, other in zip(mirrored, flat, strict=True)]


def _read_frame(fields: Fields, folder: Path, path: Path, has_moved: bool) -> FrameSource:
    """Read a frame; `has_moved` if its image is from another folder than it states."""
    depth, depth_unit = _read_depth(fields)
    return FrameSource(
        name=relative_name(path, folder),
        image=path,
        camera=_read_camera(fields, lambda: _size_of_original(fields, folder, path) if has_moved else read_size(path)),
        lens=_read_lens(fields),
        mask_path=_beside(path, folder, fields.optional_text("mask_path"), fields.where),
        depth_path=_beside(path, folder, depth, fields.where),
        depth_unit=depth_unit,
    )


def _beside(photograph: Path, folder: Path, stated: str | None, where: str) -> Path | None:
    """The file of a photograph's mask or depth, or None if none is stated or it is absent."""
    return None if stated is None else find_moved(folder, stated, where, photograph)


def _read_depth(fields: Fields) -> tuple[str | None, float]:
    """The depth map's file, or None, and its unit: from nerfstudio's fields, or else instant-ngp's."""
    depth, unit = fields.optional_text("depth_file_path"), fields.optional_number("depth_unit_scale_factor")
    scale = fields.optional_number("integer_depth_scale")
    if depth is None and scale is not None:
        return fields.optional_text("depth_path"), scale
    return depth, DEFAULT_DEPTH_UNIT if unit is None else unit


def _size_of_original(fields: Fields, folder: Path, copy: Path) -> tuple[int, int]:
    """Size of the image that a frame states, which its intrinsics refer to; `copy` is in another folder.

    Raises:
        PocketGSError: there is no such image, and the intrinsics are in pixels.
    """
    stated = fields.text("file_path")
    found = (find_moved(folder, stated + suffix, fields.where) for suffix in EXTENSIONS_TRIED)
    original = next(filter(None, found), None)
    if original is None and states_pixels(fields):
        raise PocketGSError(
            f"{fields.where}: no fields 'w' and 'h', and no image {short(stated)}, expected either: intrinsics "
            f"in pixels refer to its size, and {copy} may have another"
        )
    return read_size(original or copy)


def _read_camera(fields: Fields, image_size: Callable[[], tuple[int, int]]) -> Camera:
    stated = read_intrinsics(fields, image_size)
    return camera_at(fields.where, stated.size, stated.focal, stated.centre, _read_pose(fields))


def _read_pose(fields: Fields) -> np.ndarray:
    """World to camera from `transform_matrix`: camera to world in OpenGL axes (x right, y up, z back)."""
    matrix = fields.matrix("transform_matrix", columns=4)
    last_row_fits = len(matrix) == 3 or (len(matrix) == 4 and np.allclose(matrix[3], (0, 0, 0, 1), atol=1e-3))
    if not last_row_fits:
        raise PocketGSError(f"{fields.where}: field 'transform_matrix' is not a rigid 4x4 or 3x4 matrix")
    return world_to_camera_from_opengl(matrix[:3, :3], matrix[:3, 3], fields.where)


def _read_lens(fields: Fields) -> Lens:
    model = fields.optional_text("camera_model")
    if model is not None and model not in PERSPECTIVE_MODELS + FISHEYE_MODELS:
        raise PocketGSError(f"{fields.where}: field 'camera_model' is {short(model)}, expected one of {KNOWN_MODELS}")
    for name in LENSES_OF_INSTANT_NGP:
        if fields.values.get(name) is not None and fields.values[name] is not False:
            raise PocketGSError(
                f"{fields.where}: field '{name}' states another lens, expected a 'camera_model', one of {KNOWN_MODELS}"
            )
    fisheye = model in FISHEYE_MODELS or fields.flag("is_fisheye")
    values = _coefficients(fields)
    if not fisheye and model != RATIONAL_MODEL and values.get("k4") and not (values.get("k5") or values.get("k6")):
        raise PocketGSError(
            f"{fields.where}: the coefficient k4 is {values['k4']:g}, a fourth radial term, which OpenCV's lens does "
            "not have: calibrate without it, or export undistorted photographs"
        )
    names = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    lens = Lens("fisheye" if fisheye else "opencv", tuple(values.get(name) or 0.0 for name in names))
    return lens if lens.distorts else PINHOLE


def _coefficients(fields: Fields) -> dict[str, float | None]:
    """The lens's coefficients by name: from nerfstudio's list, or else from a field each."""
    if fields.values.get(LENS_LIST) is None:
        return {name: fields.optional_number(name) for name in LENS_FIELDS}
    return dict(zip(LISTED_COEFFICIENTS, fields.numbers(LENS_LIST, len(LISTED_COEFFICIENTS)), strict=True))
