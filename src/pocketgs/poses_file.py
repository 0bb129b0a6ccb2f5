"""Refined poses on disk: the world that a scene was trained in, for those who come with the capture's own."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pocketgs.atomic_file import replacing
from pocketgs.camera import Camera
from pocketgs.capture.capture import Capture, Frame
from pocketgs.errors import PocketGSError


def write_poses(path: Path, frames: Sequence[Frame]) -> None:
    """Write the frames' poses as JSON: 4x4 world_to_camera (OpenCV axes) by frame name."""
    poses = {frame.name: frame.camera.world_to_camera.tolist() for frame in frames}
    with replacing(path) as partial:
        partial.write_text(json.dumps({"world_to_camera": poses}) + "\n", encoding="utf-8")


def with_poses_of(capture: Capture, path: Path) -> Capture:
    """The capture with the poses in a file; frames that it does not name keep theirs.

    Raises:
        PocketGSError: the file cannot be read, or names no frame of the capture.
    """
    try:
        poses: dict[str, Any] = dict(json.loads(path.read_text(encoding="utf-8"))["world_to_camera"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise PocketGSError(f"{path}: not a readable file of poses ({error})") from error
    if not any(frame.name in poses for frame in capture.frames):
        raise PocketGSError(f"{path}: names no frame of {capture.path}, expected the capture that it was written for")
    cameras = {f.name: _posed(f.camera, poses[f.name], path) for f in capture.frames if f.name in poses}
    return capture.with_refined_poses(cameras)


def _posed(camera: Camera, pose: Any, path: Path) -> Camera:
    try:
        return replace(camera, world_to_camera=np.array(pose, dtype=np.float64))
    except (ValueError, TypeError, PocketGSError) as error:
        raise PocketGSError(f"{path}: holds what is no pose ({error})") from error
