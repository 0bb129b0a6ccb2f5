"""Export of a capture as COLMAP's text model with its images, for other trainers and viewers.

The cameras are those of the images in memory: pinhole, undistorted, cropped and downscaled, or, with `--lens direct`,
with their lenses. Points have no tracks. Masks, alpha and depth are not exported: COLMAP's model cannot hold them.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from pocketgs.capture.capture import Capture, Frame
from pocketgs.capture.hold_out import HOLD_OUT_EVERY, ordinal
from pocketgs.capture.origin import with_origin
from pocketgs.errors import PocketGSError, counted
from pocketgs.files.atomic_folder import replacing_folder
from pocketgs.files.plain_names import plain_names
from pocketgs.geometry.lens import Lens
from pocketgs.scene.point_cloud import PointCloud

IMAGES, MODEL = "images", Path("sparse") / "0"


def export_capture(
    folder: Path,
    capture: Capture,
    every: int = HOLD_OUT_EVERY,
    on_warning: Callable[[str], None] = lambda warning: None,
) -> None:
    """Write `images/*.png` and `sparse/0/{cameras,images,points3D}.txt`, all or nothing.

    Frames are numbered in an order in which a reader that holds out every n-th by name reproduces the split: that of
    their names, unless the capture is split in another way, or some of its frames are left out.

    Args:
        folder: new or empty.
        capture: the capture; if it has an origin of its own, it is moved back to the world of its files.
        every: n; 0 if nothing is held out.
        on_warning: called if the numbers of views do not allow such an order.

    Raises:
        PocketGSError: the folder is not empty, or cannot be written.
    """
    try:
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise PocketGSError(f"{folder}: is not empty, expected a new or empty folder")
        with replacing_folder(folder) as (staging, _):
            _write(staging, with_origin(capture, (0.0, 0.0, 0.0)), every, on_warning)
    except OSError as error:
        raise PocketGSError(f"{folder}: cannot be written ({error.strerror or error})") from error


def _write(folder: Path, capture: Capture, every: int, on_warning: Callable[[str], None]) -> None:
    frames = _ordered(capture, every)
    width = len(str(len(frames)))
    # The number keeps the frames in order when readers sort by name.
    plain = plain_names(frame.name for frame in frames)
    names = [f"{number:0{width}d}_{name}.png" for number, name in enumerate(plain)]
    if warning := _other_split(frames, names, {frame.name for frame in capture.held_out}, every):
        on_warning(warning)
    model = folder / MODEL
    (folder / IMAGES).mkdir()
    model.mkdir(parents=True)
    for name, frame in zip(names, frames, strict=True):
        Image.fromarray(frame.image).save(folder / IMAGES / name)
    (model / "cameras.txt").write_text(_cameras(frames), encoding="utf-8")
    (model / "images.txt").write_text(_images(names, frames), encoding="utf-8")
    (model / "points3D.txt").write_text(_points(capture.points), encoding="utf-8")


def _ordered(capture: Capture, every: int) -> list[Frame]:
    """The frames, each kind by name, so that every n-th is held out; where one kind runs out, the other goes on."""
    train, held_out = (sorted(frames, key=lambda frame: frame.name) for frames in (capture.train, capture.held_out))
    train.reverse()
    held_out.reverse()
    order: list[Frame] = []
    while train or held_out:
        is_held_out = bool(every) and len(order) % every == 0
        order.append((held_out or train if is_held_out else train or held_out).pop())
    return order


def _other_split(frames: list[Frame], names: list[str], held_out: set[str], every: int) -> str | None:
    """Tells from where on holding out every n-th frame gives another split, and what to do; None if it does not.

    Args:
        frames: in order.
        names: of their images.
        held_out: names of the frames that the capture holds out.
        every: n.
    """
    if not every:
        return None
    differing = (at for at, frame in enumerate(frames) if (frame.name in held_out) != (at % every == 0))
    first = next(differing, None)
    if first is None:
        return None
    are_held_out = counted(len(held_out), "view is held out", "views are held out")
    compared, amount = ("more", "all") if frames[first].name in held_out else ("fewer", "none")
    share = f"{compared} than every {ordinal(every)} of {len(frames)} images"
    return f"{are_held_out}, {share}: hold out {amount} from {names[first]} on"


def _cameras(frames: list[Frame]) -> str:
    """One camera per frame, because refined or cropped ones differ: CAMERA_ID MODEL WIDTH HEIGHT fx fy cx cy."""
    lines = ["# CAMERA_ID MODEL WIDTH HEIGHT fx fy cx cy"]
    for number, camera in enumerate((frame.camera for frame in frames), start=1):
        model, coefficients = _model_of(camera.lens)
        parameters = (camera.fx, camera.fy, camera.cx, camera.cy, *coefficients)
        numbers = " ".join(repr(float(value)) for value in parameters)
        lines.append(f"{number} {model} {camera.width} {camera.height} {numbers}")
    return "\n".join(lines) + "\n"


def _model_of(lens: Lens) -> tuple[str, tuple[float, ...]]:
    """COLMAP's name for a lens, and its parameters after fx, fy, cx and cy.

    Raises:
        PocketGSError: COLMAP has no such model.
    """
    if not lens.distorts:
        return "PINHOLE", ()
    if lens.model == "fisheye":
        return "OPENCV_FISHEYE", lens.coefficients
    if lens.model != "opencv" or any(lens.padded[8:]):
        raise PocketGSError(f"export: COLMAP has no model for {lens}, expected --lens undistort")
    return "FULL_OPENCV", lens.padded[:8]


def _images(names: list[str], frames: list[Frame]) -> str:
    """Two lines per frame; the second, its points, is empty."""
    # Imported here because SciPy is slow to load.
    from scipy.spatial.transform import Rotation

    lines = ["# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of points"]
    for number, (name, frame) in enumerate(zip(names, frames, strict=True), start=1):
        pose = frame.camera.world_to_camera
        x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True)
        numbers = " ".join(repr(float(value)) for value in (w, x, y, z, *pose[:3, 3]))
        lines += [f"{number} {numbers} {number} {name}", ""]
    return "\n".join(lines) + "\n"


def _points(points: PointCloud | None) -> str:
    lines = ["# POINT3D_ID X Y Z R G B ERROR TRACK"]
    if points is not None:
        colours = np.clip(np.round(points.colours * 255), 0, 255).astype(int)
        rows = enumerate(zip(points.positions.tolist(), colours.tolist(), strict=True), start=1)
        lines += [f"{number} {x!r} {y!r} {z!r} {r} {g} {b} 0" for number, ((x, y, z), (r, g, b)) in rows]
    return "\n".join(lines) + "\n"
