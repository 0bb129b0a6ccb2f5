"""Loading the scene that the user names."""

from __future__ import annotations

from pathlib import Path

from pocketgs.capture.capture import Capture
from pocketgs.files.journal import settle
from pocketgs.results.cameras_file import with_poses_of
from pocketgs.results.folder import CAMERAS, RECORD, SCENE
from pocketgs.scene.formats import is_scene_name, read_scene
from pocketgs.scene.gaussians import Gaussians


def names_scene(path: Path) -> bool:
    """Whether a path is a scene file or a result folder, rather than a capture."""
    settle(path)
    return is_scene_name(path) or all((path / name).is_file() for name in (SCENE, RECORD))


def load_scene(path: Path) -> Gaussians:
    """Read a scene file of any format, or the scene of a result folder.

    Raises:
        PocketGSError: there is no readable scene.
    """
    return read_scene(path / SCENE if path.is_dir() else path)


def in_world_of(path: Path, capture: Capture) -> Capture:
    """The capture with the poses that the scene was trained with, if they differ from the capture's.

    Raises:
        PocketGSError: they cannot be read.
    """
    cameras = (path if path.is_dir() else path.parent) / CAMERAS
    return with_poses_of(capture, cameras) if cameras.is_file() else capture
