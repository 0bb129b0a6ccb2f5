"""What there is to show of a scene on disk: alone, with its result folder, or with its capture too."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pocketgs.capture.capture import Capture
from pocketgs.errors import PocketGSError
from pocketgs.files.journal import settle
from pocketgs.files.json_fields import read_json
from pocketgs.files.opening import reading_inside
from pocketgs.results.cameras_file import read_cameras
from pocketgs.results.folder import CAMERAS, PICTURES, RECORD
from pocketgs.scene.background import checked_background
from pocketgs.scene.gaussians import Gaussians
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
    record = _record_of(result) if result else {}
    if capture:
        views, background = capture_views(capture), capture.background
    else:
        views = _views_of_result(result, record) if result else ()
        background = _background(record)
    up, target = looked_at(views) if views else (UP, np.median(gaussians.means, axis=0).tolist())
    previews = previews_in(result) if result else {}
    return Content(title, scene, background=background, views=views, up=up, target=target, previews=previews)


def previews_in(result: Path) -> dict[str, Path]:
    """A result's pictures by name, none if it has none; those that lie elsewhere, by a link, are left out."""
    root = result.resolve()
    found = (path for path in sorted((result / PICTURES).glob("*.png")) if path.is_file())
    return {path.name: path for path in found if path.resolve().is_relative_to(root)}


def _views_of_result(result: Path, record: dict[str, Any]) -> tuple[View, ...]:
    """The cameras that a result keeps, by name."""
    path = result / CAMERAS
    if not path.is_file():
        return ()
    images = record.get("images")
    named = [each.get("name") for each in images if isinstance(each, dict)] if isinstance(images, list) else []
    with reading_inside(result):
        cameras = read_cameras(path).cameras
    return tuple(View(name, camera, name in named) for name, camera in sorted(cameras.items()))


def _background(record: dict[str, Any]) -> tuple[float, float, float]:
    capture = record.get("capture")
    colour = capture.get("background") if isinstance(capture, dict) else None
    try:
        return checked_background(colour)
    except PocketGSError:  # a record of another program, or of a run whose colour nobody can show
        return (0.0, 0.0, 0.0)


def _record_of(result: Path) -> dict[str, Any]:
    """The content of `run.json`; empty if there is none.

    Raises:
        PocketGSError: it cannot be read, lies elsewhere, or holds no object.
    """
    path = result / RECORD
    if not path.is_file():
        return {}
    with reading_inside(result):
        return read_json(path).values
