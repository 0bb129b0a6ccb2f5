"""The cameras of a run on disk, with which its scene can be rendered without the capture."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pocketgs.capture.capture import Capture, Frame
from pocketgs.capture.origin import Origin, with_origin
from pocketgs.errors import PocketGSError, clipped, counted, listed
from pocketgs.files.atomic_file import replacing
from pocketgs.files.journal import settle
from pocketgs.files.json_fields import read_json
from pocketgs.files.manifest import read_manifest, source_of
from pocketgs.geometry.camera import Camera
from pocketgs.geometry.lens import PINHOLE, Lens
from pocketgs.results.folder import POSED

SAME_POSE = 1e-4
"""Maximum difference of rotations' elements, and of positions relative to the cameras' spread, by rounding."""

ONE_PLACE = 1e-6
"""Cameras that are spread by less, relative to their distance from the origin, are in one place."""

SAME_WORLD = 0.1
"""Poses lie in the world of the capture's points if refining moved them by at most this share of the cameras' spread.

Adjusted poses move by a few thousandths to hundredths, so that the points still make a good start for other trainers;
poses that were stated inverted, by more than half.
"""

MAX_NAMES = 8
"""Maximum number of names in a warning."""


@dataclass(frozen=True)
class SavedCameras:
    """The cameras that a scene was trained and evaluated with.

    Attributes:
        cameras: by frame name.
        refined: whether their poses differ from the capture's.
        origin: position of their coordinate origin in the capture's world, see `pocketgs.capture.origin`.
    """

    cameras: dict[str, Camera]
    refined: bool
    origin: Origin = (0.0, 0.0, 0.0)

    @cached_property
    def _spread(self) -> float:
        centres = np.array([camera.centre for camera in self.cameras.values()])
        # Centres in one place, as of a turn on the spot, are spread by rounding alone.
        rounding = ONE_PLACE * float(np.abs(centres).max())
        return max(float(np.ptp(centres, axis=0).max()), rounding, np.finfo(np.float64).tiny)

    @cached_property
    def _camera_to_world(self) -> np.ndarray:
        """(N, 4, 4): of each camera, in the order of the names."""
        return np.array([camera.camera_to_world for camera in self.cameras.values()]).reshape(-1, 4, 4)

    def at_pose_of(self, frame: Frame) -> list[str]:
        """Names of the cameras with a frame's pose: more than one of photographs from a tripod."""
        if not self.cameras:
            return []
        now, then = frame.camera.camera_to_world, self._camera_to_world
        turned = np.abs(now[:3, :3] - then[:, :3, :3]).max(axis=(1, 2))
        moved = np.abs(now[:3, 3] - then[:, :3, 3]).max(axis=1)
        is_same = np.maximum(turned, moved / self._spread) <= SAME_POSE
        return [name for name, same in zip(self.cameras, is_same, strict=True) if same]

    def shows(self, frame: Frame) -> bool:
        """Whether a frame's camera is here, by its name and its pose. Others may have photographs of the same names."""
        return frame.name in self.at_pose_of(frame)

    def lacks(self, frames: Sequence[Frame]) -> list[Frame]:
        """The frames whose cameras are not here, by name, or by pose if all have other names, as in another folder."""
        if any(frame.name in self.cameras for frame in frames):
            return [frame for frame in frames if frame.name not in self.cameras]
        return [frame for frame in frames if not self.at_pose_of(frame)]

    def share_moved(self, frames: Sequence[Frame]) -> float:
        """Median distance of frames with these names from the cameras here, as a share of the cameras' spread."""
        distances = [np.linalg.norm(frame.camera.centre - self.cameras[frame.name].centre) for frame in frames]
        return float(np.median(distances)) / self._spread

    def moved(self, frames: Sequence[Frame]) -> list[str]:
        """Names of the frames that have other poses than the cameras of these names."""
        return [frame.name for frame in frames if frame.name in self.cameras and not self.shows(frame)]


def write_cameras(path: Path, frames: Sequence[Frame], refined: bool, origin: Origin = (0.0, 0.0, 0.0)) -> None:
    """Write the frames' cameras as JSON.

    Each is listed by its frame's name with `size` (width and height in pixels), `intrinsics` (fx, fy, cx and cy in
    pixels, pixel centres at + 0.5) and `world_to_camera` (4x4, OpenCV axes). Adding `origin` to coordinates of cameras
    and scene gives the capture's own; it is 0 unless these are far from 0.
    """
    cameras = {frame.name: _to_json(frame.camera) for frame in frames}
    document = {"refined": refined, "origin": origin, "cameras": cameras}
    with replacing(path) as partial:
        partial.write_text(json.dumps(document) + "\n", encoding="utf-8")


def read_cameras(path: Path) -> SavedCameras:
    """Read a file that `write_cameras` wrote.

    Raises:
        PocketGSError: the file cannot be read, or an entry is not a camera.
    """
    settle(path.parent)
    try:
        document = read_json(path).values
        cameras: dict[str, Any] = dict(document["cameras"])
        refined = document["refined"] is True
        x, y, z = map(float, document.get("origin", (0, 0, 0)))
        if not np.all(np.isfinite((x, y, z))):
            raise ValueError("its origin is not finite")
    except (PocketGSError, OSError, ValueError, KeyError, TypeError, OverflowError) as error:
        raise PocketGSError(f"{path}: not a readable file of cameras ({clipped(error)})") from error
    return SavedCameras({name: _from_json(camera, name, path) for name, camera in cameras.items()}, refined, (x, y, z))


def holds_cameras(path: Path) -> bool:
    """Whether there is a file for `read_cameras`, and not a list of cameras, which 3DGS writes under the same name."""
    settle(path.parent)
    if not path.is_file():
        return False
    with path.open(encoding="utf-8", errors="replace") as file:
        return not file.read(1000).lstrip("\ufeff \t\r\n").startswith("[")


def with_poses_of(capture: Capture, path: Path, on_warning: Callable[[str], None] = lambda warning: None) -> Capture:
    """The capture with the origin of a cameras file, and with its poses if they are refined.

    Frames that the run has left out, as those are whose poses the others contradict, are left out here too, and so are
    points of another world than the poses'. Intrinsics stay the capture's: it may have been read at another size.

    Args:
        capture: as read.
        path: the file.
        on_warning: called if frames are left out.

    Raises:
        PocketGSError: the file cannot be read, or names no frame of the capture, or the capture is the one that it was
            written for, judging by its place, and has other poses than then.
    """
    saved = read_cameras(path)
    capture = with_origin(capture, saved.origin)
    if saved.refined:
        return _with_refined_poses(capture, saved, path, on_warning)
    if not _was_made_of(path.parent, capture):
        return capture
    _require_same_poses(capture, saved, path)
    # Held-out frames that are new are in the scene's world, as all others are.
    lost = saved.lacks(capture.train)
    return capture if len(lost) == len(capture.train) else _without(capture, lost, on_warning)


def _with_refined_poses(
    capture: Capture, saved: SavedCameras, path: Path, on_warning: Callable[[str], None]
) -> Capture:
    """The capture in the world of refined poses, in which only the frames of the file have a place."""
    known = [frame for frame in capture.frames if frame.name in saved.cameras]
    if not known:
        trained, read = next(iter(saved.cameras), "none"), capture.frames[0].name
        raise PocketGSError(
            f"{path}: names no frame of {capture.path}, expected the capture that it was written for, read with the "
            f"same options, such as --images: its first frame is {trained}, the capture's {read}"
        )
    if capture.points is not None and saved.share_moved(known) > SAME_WORLD:
        capture = replace(capture, points=None)
    posed = {
        frame.name: replace(frame.camera, world_to_camera=saved.cameras[frame.name].world_to_camera) for frame in known
    }
    return _without(capture, saved.lacks(capture.frames), on_warning).with_refined_poses(posed)


def _without(capture: Capture, lost: list[Frame], on_warning: Callable[[str], None]) -> Capture:
    """The capture without some of its frames; a warning names them."""
    if not lost:
        return capture
    names = [frame.name for frame in lost]
    found = counted(len(names), "photograph takes", "photographs take")
    added = "to use any that were added since, train again"
    on_warning(f"{found} no part, as in its run: {listed(names, MAX_NAMES)}; {added}")
    train, held_out = ([f for f in frames if f.name not in names] for frames in (capture.train, capture.held_out))
    return replace(capture, train=train, held_out=held_out)


def _was_made_of(result: Path, capture: Capture) -> bool:
    """Whether a result was made of a capture, by its place. Another may have photographs of the same names."""
    lies_in_it = capture.path.resolve().is_relative_to(result.resolve() / POSED)
    return lies_in_it or read_manifest(result).source == source_of(capture.path)


def _require_same_poses(capture: Capture, saved: SavedCameras, path: Path) -> None:
    """Refuse a capture that was posed anew, such as by a run that then failed: it is in another world than the scene.

    Raises:
        PocketGSError: the poses differ by more than rounding.
    """
    if moved := saved.moved(capture.frames):
        raise PocketGSError(
            f"{path}: the poses of {capture.path} have changed since this scene was trained, such as {moved[0]}, "
            "expected the same ones: train again"
        )


def _to_json(camera: Camera) -> dict[str, Any]:
    found = {
        "size": [camera.width, camera.height],
        "intrinsics": [camera.fx, camera.fy, camera.cx, camera.cy],
        "world_to_camera": camera.world_to_camera.tolist(),
    }
    if not camera.is_pinhole:
        found["lens"] = {"model": camera.lens.model, "coefficients": list(camera.lens.coefficients)}
    return found


def _from_json(saved: Any, name: str, path: Path) -> Camera:
    try:
        width, height = map(int, saved["size"])
        fx, fy, cx, cy = map(float, saved["intrinsics"])
        lens = PINHOLE
        if "lens" in saved:
            lens = Lens(str(saved["lens"]["model"]), tuple(map(float, saved["lens"]["coefficients"])))
        return Camera(width, height, fx, fy, cx, cy, np.array(saved["world_to_camera"], dtype=np.float64), lens)
    except (ValueError, TypeError, KeyError, OverflowError, PocketGSError) as error:
        raise PocketGSError(f"{path}: {name!r} is not a camera ({error})") from error
