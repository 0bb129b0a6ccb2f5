"""The content of the page."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from PIL import Image

from pocketgs.capture.capture import Capture
from pocketgs.geometry.camera import Camera
from pocketgs.geometry.camera_geometry import focus_point, looks_at, spread_of, upward
from pocketgs.scene.background import BLACK, Background

UP = (0.0, -1.0, 0.0)
"""Default up direction: structure from motion uses the first camera's axes, in which y is down."""

JPEG_QUALITY = 95


@dataclass(frozen=True)
class View:
    """One of the capture's cameras.

    Attributes:
        name: of the photograph.
        camera: of the photograph.
        held_out: whether it is held out for evaluation.
        photo: (H, W, 3) uint8, or None.
        transients: a picture of the photograph in which red marks what the run left out, since it moved or its
            pose is wrong, or None.
    """

    name: str
    camera: Camera
    held_out: bool
    photo: np.ndarray | None = None
    transients: Path | None = None


@dataclass(frozen=True)
class Content:
    """The content of the page.

    Attributes:
        title: a short name.
        scene: the file with the Gaussians, or None if a run sends them.
        is_copy: whether `scene` was made for the page, which cannot read the user's file.
        live: whether the page follows a run.
        background: RGB in [0, 1].
        views: the capture's cameras, sorted by name.
        up: (3,) up direction of the world.
        target: (3,) the point to orbit.
        previews: images for browsers without WebGPU, in addition to points, by file name.
    """

    title: str
    scene: Path | None = None
    live: bool = False
    background: Background = BLACK
    views: tuple[View, ...] = ()
    up: Sequence[float] = UP
    target: Sequence[float] = (0.0, 0.0, 0.0)
    previews: Mapping[str, Path] = field(default_factory=dict)
    is_copy: bool = False

    def __post_init__(self) -> None:
        # The file is opened at its real path, so that a link that replaces it later is not served: see `open_in_place`.
        object.__setattr__(self, "scene", self.scene and self.scene.resolve())
        object.__setattr__(self, "previews", {name: path.resolve() for name, path in self.previews.items()})

    @property
    def scene_files(self) -> dict[str, Path]:
        """The scene's file, if there is one, by its name on the page."""
        return {f"scene{self.scene.suffix.lower()}": self.scene} if self.scene else {}

    def to_json(self) -> dict[str, Any]:
        """The content of `viewer.json`.

        Raises:
            OSError: the scene's file does not exist any more.
        """
        scenes = [
            {"url": name, "bytes": path.stat().st_size, "is_copy": self.is_copy}
            for name, path in self.scene_files.items()
        ]
        return {
            "title": self.title,
            "scene": scenes[0] if scenes else None,
            "live": self.live,
            "background": list(self.background),
            "up": list(self.up),
            "target": list(self.target),
            "cameras": [_view_to_json(number, view) for number, view in enumerate(self.views)],
            "previews": [f"previews/{quote(name)}" for name in self.previews],
        }


def _view_to_json(number: int, view: View) -> dict[str, Any]:
    camera = view.camera
    return {
        "name": view.name,
        "width": camera.width,
        "height": camera.height,
        "fx": camera.fx,
        "fy": camera.fy,
        "cx": camera.cx,
        "cy": camera.cy,
        "world_to_camera": camera.world_to_camera.reshape(-1).tolist(),
        "held_out": view.held_out,
        "photo": None if view.photo is None else f"photos/{number}.jpg",
        "transients": None if view.transients is None else f"transients/{number}.png",
    }


def capture_views(capture: Capture) -> tuple[View, ...]:
    """A capture's cameras with their photographs, sorted by name."""
    views = [View(frame.name, frame.camera, False, frame.image) for frame in capture.train]
    views += [View(frame.name, frame.camera, True, frame.image) for frame in capture.held_out]
    return tuple(sorted(views, key=lambda view: view.name))


def looked_at(views: Sequence[View]) -> tuple[list[float], list[float]]:
    """The up direction and the point to orbit, (3,) each, from at least one camera."""
    cameras = [view.camera for view in views]
    target = focus_point(cameras)
    if not looks_at(cameras, target):
        # Cameras that face outwards have no common subject: use the first one's view.
        centres = np.array([camera.centre for camera in cameras])
        distance = float(np.ptp(centres, axis=0).max()) if spread_of(centres) > 0 else 1.0
        target = cameras[0].centre + cameras[0].forward * distance
    return upward(cameras).tolist(), target.tolist()


def jpeg(photo: np.ndarray) -> bytes:
    """Encode a (H, W, 3) uint8 photograph as JPEG without chroma subsampling, for comparisons."""
    content = io.BytesIO()
    Image.fromarray(photo).save(content, "JPEG", quality=JPEG_QUALITY, subsampling=0)
    return content.getvalue()
