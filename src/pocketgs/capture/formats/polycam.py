"""Reader of Polycam's raw data: keyframes of an iPhone with LiDAR, with corrected poses if Polycam computed them.

The layout is documented in the README of PolyCam/polyform.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pocketgs.capture.listing import FrameSource, Listing
from pocketgs.capture.poses import camera_at, world_to_camera_from_opengl
from pocketgs.errors import PocketGSError
from pocketgs.files.json_fields import DamagedJsonError, Fields, read_json
from pocketgs.files.paths import existing_file, relative_name

FORMAT = "polycam"
LOOKED_FOR = "keyframes/cameras or keyframes/corrected_cameras"
KEYFRAMES = "keyframes"
IMAGE_SUFFIXES = (".jpg", ".JPG", ".jpeg", ".JPEG")
CAMERA_FILES = "[!.]*.json"  # without the hidden files that macOS adds
CORRECTED, UNCORRECTED = "corrected_", ""

UNDISTORTION_BORDER = 15
"""Pixels at each side of a corrected image that undistortion may have left black, as in nerfstudio's importer."""


def recognises(path: Path) -> bool:
    """Whether the folder holds Polycam's cameras."""
    return any((path / KEYFRAMES / f"{kind}cameras").is_dir() for kind in (CORRECTED, UNCORRECTED))


def read(path: Path, images: str | None = None) -> Listing:
    """Read the keyframes, corrected ones if there are any, else as ARKit tracked them.

    Raises:
        PocketGSError: a camera is malformed, most are damaged, none has an image, or `images` is given, which the
            format does not support.
    """
    if images is not None:
        raise PocketGSError(f"{path}: images='{images}' given, but Polycam's captures keep theirs in {KEYFRAMES}")
    kind = CORRECTED if _has_keyframes(path, CORRECTED) else UNCORRECTED
    folder = path / KEYFRAMES / f"{kind}cameras"
    cameras = sorted(folder.glob(CAMERA_FILES))
    frames: list[FrameSource | None] = []
    damaged: list[DamagedJsonError] = []
    for file in cameras:
        try:
            frames.append(_frame(path, kind, file.stem))
        except DamagedJsonError as error:
            damaged.append(error)
    if 2 * len(damaged) > len(cameras):
        raise damaged[0]
    present = [frame for frame in frames if frame is not None]
    if not present:
        raise PocketGSError(f"{folder}: none of its {len(cameras)} cameras has an image in {KEYFRAMES}/{kind}images")
    warnings: tuple[str, ...] = ()
    if kind == UNCORRECTED:
        warnings += (f"{path}: without corrected cameras, so ARKit's poses are used, which drift",)
    if len(present) < len(frames):
        warnings += (f"{folder}: {len(frames) - len(present)} of {len(cameras)} cameras have no image",)
    if damaged:
        found = f"{folder}: {len(damaged)} of {len(cameras)} cameras are damaged, the first ({damaged[0]})"
        warnings += (f"{found}: these frames are left out; copy them again",)
    return Listing(FORMAT, present, metric=True, warnings=warnings)


def _has_keyframes(path: Path, kind: str) -> bool:
    folder = path / KEYFRAMES
    return (folder / f"{kind}images").is_dir() and any((folder / f"{kind}cameras").glob(CAMERA_FILES))


def _frame(path: Path, kind: str, timestamp: str) -> FrameSource | None:
    """The frame of a timestamp, or None if it has no image."""

    def find(name: str, suffixes: tuple[str, ...] = ("",)) -> Path | None:
        return existing_file(path, f"{KEYFRAMES}/{name}", str(path), suffixes)

    image, camera = find(f"{kind}images/{timestamp}", IMAGE_SUFFIXES), find(f"{kind}cameras/{timestamp}.json")
    if image is None or camera is None:
        return None
    fields = read_json(camera)
    depth = find(f"depth/{timestamp}.png")
    return FrameSource(
        name=relative_name(image, path),
        image=image,
        camera=camera_at(
            fields.where,
            (fields.number("width"), fields.number("height")),
            (fields.number("fx"), fields.number("fy")),
            (fields.number("cx"), fields.number("cy")),
            _pose(fields),
        ),
        depth_path=depth,
        confidence_path=None if depth is None else find(f"confidence/{timestamp}.png"),
        border=UNDISTORTION_BORDER if kind == CORRECTED else 0,
    )


def _pose(fields: Fields) -> np.ndarray:
    """World to camera from t_00 … t_23, the rows of camera to world in ARKit's axes (x right, y up, z back)."""
    matrix = np.array([[fields.number(f"t_{row}{column}") for column in range(4)] for row in range(3)])
    return world_to_camera_from_opengl(matrix[:, :3], matrix[:, 3], fields.where)
