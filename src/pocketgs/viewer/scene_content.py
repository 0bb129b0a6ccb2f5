"""The content of the page for a scene on disk, with or without its result folder and its capture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pocketgs.capture.capture import Capture
from pocketgs.errors import PocketGSError
from pocketgs.files.journal import settle
from pocketgs.files.json_fields import read_json
from pocketgs.files.opening import reading_inside
from pocketgs.files.plain_names import plain_names
from pocketgs.results.cameras_file import read_cameras
from pocketgs.results.folder import CAMERAS, PICTURES, RECORD, TRANSIENTS
from pocketgs.scene.background import Background, checked_background
from pocketgs.scene.gaussians import Gaussians
from pocketgs.viewer.content import UP, Content, View, capture_views, looked_at


def scene_content(
    title: str, scene: Path, gaussians: Gaussians, result: Path | None, capture: Capture | None
) -> Content:
    """Make the content for a finished scene.

    Without the capture, the cameras of a result folder are shown without photographs, which results do not contain.

    Args:
        title: a short name.
        scene: the file with the Gaussians.
        gaussians: its content.
        result: the result folder that it belongs to, or None.
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
    up, target = looked_at(views) if views else (UP, _middle(gaussians.means))
    previews = previews_in(result) if result else {}
    views = with_transients(views, result) if result else views
    return Content(title, scene, background=background, views=views, up=up, target=target, previews=previews)


def _middle(means: np.ndarray) -> list[float]:
    """The median of (N, 3) positions; 0 if none is finite."""
    finite = means[np.isfinite(means).all(axis=1)]
    return [float(value) for value in np.median(finite, axis=0)] if len(finite) else [0.0, 0.0, 0.0]


def previews_in(result: Path) -> dict[str, Path]:
    """A result's images of held-out views by name; empty if there are none. Links that lead elsewhere are left out."""
    return {path.name: path for path in _pictures_in(result, PICTURES)}


def with_transients(views: Sequence[View], result: Path) -> tuple[View, ...]:
    """The views with a result's pictures of what moved in their photographs. Links that lead elsewhere are left out."""
    pictures = {path.stem: path.resolve() for path in _pictures_in(result, TRANSIENTS)}
    trained = [view.name for view in views if not view.held_out]
    picture_of = {name: pictures.get(plain) for name, plain in zip(trained, plain_names(trained), strict=True)}
    return tuple(replace(view, transients=picture_of.get(view.name)) for view in views)


def _pictures_in(result: Path, folder: str) -> list[Path]:
    root = result.resolve()
    found = (path for path in sorted((result / folder).glob("*.png")) if path.is_file())
    return [path for path in found if path.resolve().is_relative_to(root)]


def _views_of_result(result: Path, record: dict[str, Any]) -> tuple[View, ...]:
    """The cameras in a result folder, sorted by name."""
    path = result / CAMERAS
    if not path.is_file():
        return ()
    images = record.get("images")
    named = [each.get("name") for each in images if isinstance(each, dict)] if isinstance(images, list) else []
    with reading_inside(result):
        cameras = read_cameras(path).cameras
    return tuple(View(name, camera, name in named) for name, camera in sorted(cameras.items()))


def _background(record: dict[str, Any]) -> Background:
    capture = record.get("capture")
    colour = capture.get("background") if isinstance(capture, dict) else None
    try:
        return checked_background(colour)
    except PocketGSError:  # written by another program, or not a valid colour
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
