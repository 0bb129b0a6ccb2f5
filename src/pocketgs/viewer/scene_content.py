"""What there is to show of a scene on disk: alone, with its result folder, or with its capture too."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from pocketgs.cameras_file import read_cameras
from pocketgs.capture.capture import Capture
from pocketgs.errors import PocketGSError
from pocketgs.gaussians import Gaussians
from pocketgs.publishing.journal import settle
from pocketgs.result_folder import CAMERAS, PICTURES, RECORD
from pocketgs.viewer.content import UP, Content, View, capture_views, looked_at


def scene_content(
    title: str, scene: Path, gaussians: Gaussians, result: Path | None, capture: Capture | None
) -> Content:
    """Content for a scene that is done.

    Without its capture, the cameras of a result folder are shown without photographs: a result keeps none.

    Args:
        title: a short name.
        scene: the file with the Gaussians.
        gaussians: what is in it.
        result: the result folder that it stands in, or None.
        capture: with the poses that the scene was trained with, or None.

    Raises:
        PocketGSError: a file of the result folder cannot be read.
    """
    if result:
        settle(result)
    record = _read_json(result / RECORD) if result else {}
    if capture:
        views, background = capture_views(capture), capture.background
    else:
        views = _views_of_result(result, record) if result else ()
        background = _background(record)
    up, target = looked_at(views) if views else (UP, np.median(gaussians.means, axis=0).tolist())
    previews = previews_in(result / PICTURES) if result else {}
    return Content(title, scene, background=background, views=views, up=up, target=target, previews=previews)


def previews_in(folder: Path) -> dict[str, Path]:
    """The PNGs of a folder by name, empty if there is no such folder; links that lead out of it are left out."""
    root = folder.resolve()
    found = (path for path in sorted(folder.glob("*.png")) if path.is_file())
    return {path.name: path for path in found if path.resolve().parent == root}


def _views_of_result(result: Path, record: dict[str, Any]) -> tuple[View, ...]:
    """The cameras that a result keeps, by name."""
    path = result / CAMERAS
    if not path.is_file():
        return ()
    held_out = {image["name"] for image in record.get("images", [])}
    return tuple(View(name, camera, name in held_out) for name, camera in sorted(read_cameras(path).cameras.items()))


def _background(record: dict[str, Any]) -> tuple[float, float, float]:
    capture = record.get("capture")
    colour = capture.get("background") if isinstance(capture, dict) else None
    if isinstance(colour, list) and len(colour) == 3 and all(isinstance(value, int | float) for value in colour):
        return (colour[0], colour[1], colour[2])
    return (0.0, 0.0, 0.0)


def _read_json(path: Path) -> dict[str, Any]:
    """An object in a file; empty if there is no such file.

    Raises:
        PocketGSError: it cannot be read, or holds no object.
    """
    if not path.is_file():
        return {}
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise PocketGSError(f"{path}: cannot be read ({error})") from error
    if not isinstance(found, dict):
        raise PocketGSError(f"{path}: holds no JSON object")
    return found
