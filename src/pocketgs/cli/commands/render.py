"""`pocketgs render`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro
from PIL import Image

from pocketgs.capture import Capture
from pocketgs.capture.decoding.video_file import VIDEO_SUFFIXES
from pocketgs.capture.open import video_of
from pocketgs.capture.options import CaptureOptions
from pocketgs.cli.output_file import VIDEO_FILE, check_replaceable
from pocketgs.cli.scene_file import drawn_by, in_world_of, read_for, run_of
from pocketgs.cli.terminal import Terminal
from pocketgs.errors import PocketGSError, counted
from pocketgs.files.memory_bound import memory_bound
from pocketgs.files.paths import IMAGE_SUFFIXES
from pocketgs.files.plain_names import plain_names
from pocketgs.geometry.camera import Camera
from pocketgs.results.folder import publishing_pictures
from pocketgs.results.video import even_size, write_video
from pocketgs.scene.background import Background
from pocketgs.splat.engine import EngineOptions, Renderer, Rendering

VIDEO = ".mp4"
OTHER_FILES = (VIDEO_SUFFIXES - {VIDEO}) | {".gif", ".mpg", ".mpeg", ".wmv", ".flv", ".ogv"} | IMAGE_SUFFIXES
"""Suffixes of names that mean a file which cannot be written, and no folder."""

FRAMES, FPS, MAX_FRAMES = 120, 30.0, 100_000

NEAR = 0.99
"""Quantile of 1 / depth that is white."""

LOOKED_AT, PIXELS = 12, 100_000
"""Maximum number of views that the brightness of depths is chosen by, and about the pixels of each."""

Views = Literal["held-out", "train", "orbit", "path"]
Show = Literal["colour", "depth", "alpha"]


def render(
    scene: Annotated[Path, tyro.conf.Positional],
    capture: Annotated[Path, tyro.conf.Positional],
    output: Path,
    views: Views = "orbit",
    show: Show = "colour",
    frames: int = FRAMES,
    fps: float = FPS,
    poses_of: Path | None = None,
    engine: EngineOptions = EngineOptions(),  # noqa: B008 - a frozen dataclass
    reading: CaptureOptions = CaptureOptions(),  # noqa: B008 - a frozen dataclass
) -> None:
    """Render a scene to images or a video.

    Args:
        scene: A scene file (.ply, .pgs, .spz, .glb …), or a result folder.
        capture: The capture whose cameras are used: its folder, or its transforms.json.
        output: A folder for PNGs, in place of those of an earlier rendering, or a video if it ends in .mp4.
        views: The capture's held-out or training views, an orbit around its subject, or a smooth path through its
            training views.
        show: Colour, expected depth (near is bright, equally in all views) or alpha.
        frames: Number of views of an orbit or path.
        fps: Frames per second of a video.
        poses_of: The result folder of the scene's run, if the scene lies outside it: for its poses, background and
            split.
        engine: Options of the engine.
        reading: Options for reading the capture.
    """
    is_video, run = output.suffix.lower() == VIDEO, run_of(scene, poses_of)
    _check_options(output, is_video, views, frames, fps)
    if is_video:
        check_replaceable(output, VIDEO_FILE, [scene, video_of(capture)])
    with memory_bound(engine.max_memory):
        renderer, _ = drawn_by(scene, engine)
        opened = in_world_of(run, read_for(run, capture, reading))
    named_cameras = _cameras(opened, views, frames)
    cameras = [camera for _, camera in named_cameras]
    sizes = sorted({even_size(camera.width, camera.height) for camera in cameras})
    if is_video and len(sizes) > 1:
        (width, height), (other_width, other_height), *_ = sizes
        found = f"found views of {width}x{height} and of {other_width}x{other_height}"
        raise PocketGSError(f"{output}: {found}, expected one size in a video: name a folder, or --views path")
    renderings = (renderer.render(camera, opened.background, show == "depth") for camera in cameras)
    nearest = _nearest(renderer, cameras, opened.background) if show == "depth" else 1.0
    pictures = (_picture(rendering, show, nearest) for rendering in renderings)
    if is_video:
        try:
            output.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise PocketGSError(f"{output}: its folder cannot be made ({error.strerror or error})") from error
        write_video(output, pictures, fps)
    else:
        _write_pictures(output, [name for name, _ in named_cameras], pictures)
    Terminal().say(f"{counted(len(cameras), 'view', 'views')} in {output}")


def _check_options(output: Path, is_video: bool, views: Views, frames: int, fps: float) -> None:
    """Refuse a file that cannot be written, and options that would have no effect.

    Raises:
        PocketGSError: there is one.
    """
    if output.suffix.lower() in OTHER_FILES and not output.is_dir():
        raise PocketGSError(f"{output}: cannot be written, expected a name that ends in {VIDEO}, or that of a folder")
    if frames != FRAMES and views not in ("orbit", "path"):
        raise PocketGSError("--frames concerns an orbit or a path: expected --views orbit or path with it")
    if fps != FPS and not is_video:
        raise PocketGSError(f"--fps concerns a video: expected an output that ends in {VIDEO} with it, not {output}")


def _cameras(capture: Capture, views: Views, frames: int) -> list[tuple[str, Camera]]:
    """Cameras to render, with names for their files."""
    if views in ("held-out", "train"):
        chosen = capture.held_out if views == "held-out" else capture.train
        if not chosen:
            raise PocketGSError(f"{capture.path}: no view is held out, expected --hold-out of at least 2")
        names = plain_names(frame.name for frame in chosen)
        return [(name, frame.camera) for name, frame in zip(names, chosen, strict=True)]
    # Imported here because SciPy's splines are slow to load.
    from pocketgs.geometry.camera_path import orbit, path

    if not 1 <= frames <= MAX_FRAMES:
        raise PocketGSError(f"frames: found {frames}, expected at least 1 and at most {MAX_FRAMES}")
    given = [frame.camera for frame in capture.train]
    made = orbit(given, frames) if views == "orbit" else path(given, frames)
    return [(f"{number:04d}", camera) for number, camera in enumerate(made)]


def _nearest(renderer: Renderer, cameras: Sequence[Camera], background: Background) -> float:
    """The inverse depth to show as white in all views, so that a surface is equally bright in each of them."""
    places = np.linspace(0, len(cameras) - 1, min(len(cameras), LOOKED_AT)).round().astype(int)
    inverses: list[np.ndarray] = []
    for place in places:
        depth = renderer.render(cameras[place], background, depth=True).depth
        assert depth is not None
        seen = depth[depth > 0]
        inverses.append(1.0 / seen[:: max(1, len(seen) // PIXELS)])
    together = np.concatenate(inverses)
    return float(np.quantile(together, NEAR)) if len(together) else 1.0


def _picture(rendering: Rendering, show: Show, nearest: float) -> np.ndarray:
    """(H, W, 3) uint8 image for display; `nearest` is the inverse depth that is white."""
    if show == "colour":
        shown = rendering.image
    elif show == "alpha":
        shown = np.repeat(rendering.alpha[..., None], 3, axis=2)
    else:
        assert rendering.depth is not None
        inverse = np.divide(1.0, rendering.depth, out=np.zeros_like(rendering.depth), where=rendering.depth > 0)
        shown = np.repeat((inverse / nearest * rendering.alpha)[..., None], 3, axis=2)
    return np.round(np.clip(shown, 0.0, 1.0) * 255.0).astype(np.uint8)


def _write_pictures(folder: Path, names: list[str], pictures: Iterator[np.ndarray]) -> None:
    with publishing_pictures(folder, [f"{name}.png" for name in names]) as staging:
        for name, picture in zip(names, pictures, strict=True):
            Image.fromarray(picture).save(staging / f"{name}.png")
