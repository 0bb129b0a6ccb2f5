"""The views for fine-tuning, decisions and reports: photographs, or renderings of the scene itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pocketgs.capture.capture import Capture, Frame
from pocketgs.capture.even_choice import evenly_chosen
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera, look_at
from pocketgs.scene.background import Background
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import Engine
from pocketgs.splat.rendering import render_frame

EVERY = 8
"""Every eighth rendered view is for the report, and those halfway between them are for decisions."""

RENDERED_VIEWS = 100
"""Maximum number of renderings of the scene itself."""

SIDE = 400
"""Image side of renderings of a scene whose cameras are unknown."""

FOCAL = 1.2
"""Focal length of such renderings, relative to the image side: 45 degrees."""

RINGS, VIEWS_OF_RING = (-0.3, 0.2, 0.7), 16
"""Elevations of the rings of cameras around the scene, as sines, and cameras on each."""

DISTANCE = 2.5
"""Radius of the rings, relative to the scene's."""


@dataclass(frozen=True)
class Views:
    """The views of a compression.

    Attributes:
        train: for fine-tuning.
        judges: for decisions, not used for fine-tuning. May be empty if they are photographs.
        reported: for the report; not used for fine-tuning or decisions. May be empty.
        background: behind the scene, RGB in [0, 1].
        photographs: whether they are photographs; otherwise they are renderings of the scene itself.
    """

    train: list[Frame]
    judges: list[Frame]
    reported: list[Frame]
    background: Background
    photographs: bool


def photographed(capture: Capture) -> Views:
    """The views of a capture: every other held-out photograph is for decisions, the rest for the report.

    Training views that are masked completely, as those are that a run left out, take no part.

    Raises:
        PocketGSError: there is no training view.
    """
    train = [frame for frame in capture.train if frame.mask is None or frame.mask.any()]
    if not train:
        raise PocketGSError(f"{capture.path}: no training view that is not masked completely, expected at least one")
    return Views(train, capture.held_out[1::2], capture.held_out[::2], capture.background, True)


def not_too_many(cameras: Mapping[str, Camera]) -> dict[str, Camera]:
    """At most RENDERED_VIEWS of the cameras, evenly chosen."""
    names = list(cameras)
    return {names[place]: cameras[names[place]] for place in evenly_chosen(len(names), RENDERED_VIEWS)}


def rendered(scene: Gaussians, cameras: Mapping[str, Camera], engine: Engine, background: Background) -> Views:
    """Renderings of the scene itself, some for decisions and some for the report.

    Args:
        scene: to render.
        cameras: by name; see `not_too_many`.
        engine: renders; the scene stays uploaded.
        background: behind the scene.
    """
    frames = renderings(scene, cameras, engine, background)
    if len(frames) < EVERY:
        return Views(frames, frames, frames, background, False)
    train = [frame for place, frame in enumerate(frames) if place % EVERY not in (0, EVERY // 2)]
    return Views(train, frames[EVERY // 2 :: EVERY], frames[::EVERY], background, False)


def renderings(scene: Gaussians, cameras: Mapping[str, Camera], engine: Engine, background: Background) -> list[Frame]:
    """Renderings of the scene itself; arguments as those of `rendered`."""
    engine.upload(scene)
    return [_rendering(name, camera, engine, background) for name, camera in cameras.items()]


def _rendering(name: str, camera: Camera, engine: Engine, background: Background) -> Frame:
    frame = Frame(name, camera, np.zeros((camera.height, camera.width, 3), np.uint8))
    image = np.nan_to_num(render_frame(engine, frame, background))
    return Frame(name, camera, np.round(image * 255.0).astype(np.uint8))


def cameras_around(scene: Gaussians) -> dict[str, Camera]:
    """Cameras for a scene without known cameras: on rings around it, and at its centre, looking outwards.

    Raises:
        PocketGSError: the scene has no extent.
    """
    finite = scene.means[np.isfinite(scene.means).all(axis=1)].astype(np.float64)
    centre = np.median(finite, axis=0) if len(finite) else np.zeros(3)
    radius = float(np.quantile(np.linalg.norm(finite - centre, axis=1), 0.9)) if len(finite) else 0.0
    if radius <= 0.0:
        raise PocketGSError("scene: it is a single point, expected Gaussians in several places")
    directions = [_direction(height, turn) for height in RINGS for turn in np.arange(VIEWS_OF_RING) / VIEWS_OF_RING]
    outside = [_camera(centre + DISTANCE * radius * each, centre) for each in directions]
    inside = [_camera(centre, centre + radius * each) for each in directions]
    pairs = list(zip(outside, inside, strict=True))
    # Views for the report and for decisions, at fixed distances in the list, are of both kinds and from all sides.
    turned = [pair if place // (EVERY // 2) % 2 else pair[::-1] for place, pair in enumerate(pairs)]
    return {f"{number:03d}": camera for number, camera in enumerate(camera for pair in turned for camera in pair)}


def _direction(height: float, turn: float) -> np.ndarray:
    flat = np.sqrt(1.0 - height**2)
    angle = 2.0 * np.pi * turn
    return np.array([flat * np.cos(angle), flat * np.sin(angle), height])


def _camera(eye: np.ndarray, target: np.ndarray) -> Camera:
    pose = look_at(eye, target, np.array([0.0, 0.0, 1.0]))
    return Camera(SIDE, SIDE, FOCAL * SIDE, FOCAL * SIDE, 0.5 * SIDE, 0.5 * SIDE, pose)
