"""Finding the scene that a user names."""

from __future__ import annotations

from pathlib import Path

from pocketgs.gaussians import Gaussians
from pocketgs.result_folder import SCENE


def load_scene(path: Path) -> Gaussians:
    """Read a .ply, or the scene of a result folder.

    Raises:
        PocketGSError: there is no readable scene.
    """
    return Gaussians.load(path / SCENE if path.is_dir() else path)
