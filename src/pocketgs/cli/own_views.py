"""A scene without its capture: renderings of it take the photographs' place."""

from __future__ import annotations

from pathlib import Path

from pocketgs.capture.capture import Capture
from pocketgs.cli.scene_file import folder_of, warn
from pocketgs.compression.views import cameras_around, not_too_many, renderings
from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import require_memory
from pocketgs.geometry.camera import Camera
from pocketgs.results.cameras_file import holds_cameras, read_cameras
from pocketgs.results.folder import CAMERAS, COMPRESSED, SCENE
from pocketgs.results.trained_on import trained_on
from pocketgs.scene.background import BLACK, Background
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import Engine

BYTES_PER_PIXEL = 3
"""Of a rendering."""


def trained_cameras(scene: Path) -> dict[str, Camera]:
    """The cameras of a scene's result folder, by name; empty if there is none."""
    path = folder_of(scene) / CAMERAS
    return read_cameras(path).cameras if holds_cameras(path) else {}


def cameras_of_result(scene: Path) -> dict[str, Camera]:
    """The cameras of a result, by name; empty for other files, even beside it: their scenes may have been moved.

    Args:
        scene: a file, or a result folder.
    """
    return trained_cameras(scene) if scene.is_dir() or scene.name in (SCENE, COMPRESSED) else {}


def own_cameras(scene: Path, gaussians: Gaussians) -> dict[str, Camera]:
    """Cameras to render a scene from: those of its result, or some around it, with a warning beside a result.

    Args:
        scene: a file, or a result folder.
        gaussians: its content.

    Raises:
        PocketGSError: the folder's cameras cannot be read, or the scene has no extent.
    """
    cameras = cameras_of_result(scene)
    if not cameras and trained_cameras(scene):
        found = "may have been moved since the run beside it: it is drawn from around, not from the run's cameras"
        warn(scene, f"{found}; give the capture for a smaller file")
    return not_too_many(cameras or cameras_around(gaussians))


def own_background(scene: Path) -> Background:
    """The background that the run of a scene's result folder was trained with; black without a run."""
    known = trained_on(folder_of(scene))
    return known.background if known else BLACK


def rendered_capture(scene: Path, gaussians: Gaussians, engine: Engine, background: Background | None) -> Capture:
    """A capture of renderings of a scene from the cameras of its result, for training.

    Args:
        scene: a result folder, or the scene in one.
        gaussians: its content.
        engine: renders; the scene stays uploaded.
        background: None for that of the scene's run.

    Raises:
        PocketGSError: there are no cameras, or they cannot be read, or the images exceed the memory bound.
    """
    cameras = not_too_many(cameras_of_result(scene))
    if not cameras:
        found = f"no result's {SCENE} with {CAMERAS} beside it"
        raise PocketGSError(f"{scene}: found {found}, expected its result folder, or its capture")
    pixels = sum(camera.width * camera.height for camera in cameras.values())
    require_memory(scene, BYTES_PER_PIXEL * pixels, f"{len(cameras)} renderings of it")
    background = background or own_background(scene)
    frames = renderings(gaussians, cameras, engine, background)
    return Capture(
        scene.stem, scene, "renderings", frames, [], background=background, protocol="renderings of the scene itself"
    )
