"""Options of structure from motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from pocketgs.capture.masks import FOUND
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import MAX_SIDE

CameraModel = Literal["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE"]


@dataclass(frozen=True)
class PoseOptions:
    """Options of structure from motion.

    Attributes:
        most_frames: Maximum number of frames from a video, the sharpest of as many equal windows. All photographs are
            used.
        max_size: Features are computed in images reduced to this many pixels on the longer side.
        masks: Folder with masks of photographs, white for pixels to use. By default a folder masks or mask beside them;
            "none" uses no masks.
        camera_model: COLMAP's name for the lens model; images of one size share one camera.
        seed: Random seed.
    """

    most_frames: int = 150
    max_size: int = 1600
    masks: str = FOUND
    camera_model: CameraModel = "OPENCV"
    seed: int = 0

    def __post_init__(self) -> None:
        checks = {
            "most frames": (self.most_frames, self.most_frames >= 3, "at least 3"),
            "max size": (self.max_size, 64 <= self.max_size <= MAX_SIDE, f"64 to {MAX_SIDE} pixels"),
            "camera model": (
                self.camera_model,
                self.camera_model in get_args(CameraModel),
                f"one of {', '.join(get_args(CameraModel))}",
            ),
            "seed": (self.seed, 0 <= self.seed < 2**31, "from 0 to 2147483647"),
        }
        for what, (found, sound, expected) in checks.items():
            if not sound:
                raise PocketGSError(f"{what}: found {found}, expected {expected}")
