"""Reader of 3D Scanner App (Laan Labs) recordings, exported with "All Data".

The layout and the camera axes are those of a real recording: its depth maps agree with each other only if they are read
in these axes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pocketgs.capture.decoding.image_file import read_size
from pocketgs.capture.listing import FrameSource, Listing
from pocketgs.capture.poses import ARKIT_PIXEL_CENTRE, camera_at, world_to_camera_from_opengl
from pocketgs.capture.sharpness import sharpest_photographs, thinning_warning
from pocketgs.errors import PocketGSError
from pocketgs.files.json_fields import Fields, read_json
from pocketgs.files.paths import existing_file
from pocketgs.geometry.camera import Camera

FORMAT = "3d-scanner-app"
LOOKED_FOR = "frame_00000.json with cameraPoseARFrame"
CAMERA_FILES = "frame_*.json"


def recognises(path: Path) -> bool:
    """Whether the folder holds a camera file of the app."""
    first = min(path.glob(CAMERA_FILES), default=None) if path.is_dir() else None
    return first is not None and first.is_file() and b'"cameraPoseARFrame"' in first.read_bytes()


def read(path: Path, images: str | None = None) -> Listing:
    """Choose the sharpest photographs and read their cameras.

    The app stores poses and depths many times a second, and a photograph for only some of them; the rest are not used.

    Raises:
        PocketGSError: a camera file is malformed, no pose has a photograph, or `images` is given, which the format does
            not support.
    """
    if images is not None:
        raise PocketGSError(f"{path}: images='{images}' given, but 3D Scanner App keeps its images beside the poses")
    cameras = sorted(path.glob(CAMERA_FILES))
    files = {number: existing_file(path, f"{file.stem}.jpg", str(path)) for number, file in enumerate(cameras)}
    photographs = {number: file for number, file in files.items() if file is not None}
    if not photographs:
        raise PocketGSError(f"{path}: none of its {len(cameras)} poses has a photograph frame_NNNNN.jpg")
    chosen = sharpest_photographs(photographs)
    frames = [_frame(path, cameras[number], photographs[number]) for number in chosen]
    return Listing(FORMAT, frames, metric=True, warnings=thinning_warning(str(path), len(chosen), len(photographs)))


def _frame(path: Path, camera_file: Path, photograph: Path) -> FrameSource:
    number = camera_file.stem.removeprefix("frame_")
    depth = existing_file(path, f"depth_{number}.png", str(path))
    return FrameSource(
        name=photograph.name,
        image=photograph,
        camera=_camera(read_json(camera_file), photograph),
        depth_path=depth,
        confidence_path=None if depth is None else existing_file(path, f"conf_{number}.png", str(path)),
    )


def _camera(fields: Fields, photograph: Path) -> Camera:
    """Read a camera: pose from camera to world by rows in ARKit's axes (x right, y up, z back), intrinsics by rows."""
    pose, matrix = fields.numbers("cameraPoseARFrame", 16).reshape(4, 4), fields.numbers("intrinsics", 9).reshape(3, 3)
    return camera_at(
        fields.where,
        _size(fields, matrix, photograph),
        (matrix[0, 0], matrix[1, 1]),
        (matrix[0, 2] + ARKIT_PIXEL_CENTRE, matrix[1, 2] + ARKIT_PIXEL_CENTRE),
        world_to_camera_from_opengl(pose[:3, :3], pose[:3, 3], fields.where),
    )


def _size(fields: Fields, matrix: np.ndarray, photograph: Path) -> tuple[float, float]:
    """The image size that the intrinsics refer to; the photograph's if the projection matrix does not determine it.

    A projection's first two scales are twice the focal lengths over width and height.
    """
    if "projectionMatrix" not in fields.values:
        return read_size(photograph)
    projection = fields.numbers("projectionMatrix", 16).reshape(4, 4)
    if projection[0, 0] <= 0 or projection[1, 1] <= 0:
        raise PocketGSError(f"{fields.where}: field 'projectionMatrix' is not a perspective projection")
    return 2 * matrix[0, 0] / projection[0, 0], 2 * matrix[1, 1] / projection[1, 1]
