"""Loading the scene that the user names."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np

from pocketgs.capture.capture import Capture
from pocketgs.capture.open import lacks_poses, video_of
from pocketgs.capture.options import CaptureOptions
from pocketgs.cli.capture_options import read_capture
from pocketgs.cli.terminal import Terminal
from pocketgs.errors import PocketGSError
from pocketgs.files.journal import settle
from pocketgs.results.cameras_file import holds_cameras, with_poses_of
from pocketgs.results.folder import CAMERAS, RECORD, SCENE, posed_folder
from pocketgs.results.trained_on import trained_on
from pocketgs.results.transients import without_transients_of
from pocketgs.scene.formats import is_scene_name, read_scene
from pocketgs.scene.gaussians import Gaussians
from pocketgs.sort_free.drawing import drawing_of
from pocketgs.sort_free.edits import edited
from pocketgs.sort_free.file import is_sort_free, read_sort_free
from pocketgs.sort_free.scene import SortFreeScene
from pocketgs.splat.choose_engine import create_engine
from pocketgs.splat.engine import EngineOptions, Renderer

AnyScene: TypeAlias = Gaussians | SortFreeScene
"""A scene that is drawn sorted, or one that is drawn without sorting."""


OTHER_SCENES = (".ksplat", ".splatv", ".spx", ".lcc", ".rad")
"""Suffixes of scenes that PocketGS cannot read."""

UNBUNDLED = ("meta.json", "means_l.webp")
"""Files of a SOG in a folder."""

OWN_POSES = (
    "lies outside a result folder, so that the capture's own poses are used: if its run refined them, name its result "
    "folder by --poses-of"
)


def names_scene(path: Path) -> bool:
    """Whether a path is a scene, also of a kind that cannot be read, or a result folder, rather than a capture."""
    settle(path)
    if is_scene_name(path) or path.name.lower().endswith(OTHER_SCENES):
        return True
    return _holds(path, (SCENE, RECORD)) or _holds(path, UNBUNDLED)


def _holds(folder: Path, names: Iterable[str]) -> bool:
    """Whether a path is a folder with all of these files."""
    return all((folder / name).is_file() for name in names)


def folder_of(scene: Path) -> Path:
    """The result folder that a scene belongs to, if it belongs to one."""
    return scene if scene.is_dir() else scene.parent


def run_of(scene: Path, poses_of: Path | None) -> Path:
    """What tells how a scene was trained: the result that the user names, or the scene itself, which may lie in one.

    Raises:
        PocketGSError: what the user names is no result with the cameras of a run.
    """
    return scene if poses_of is None else checked_result(poses_of)


def checked_result(named: Path) -> Path:
    """The result folder that the user named, by itself or by a file in it.

    Raises:
        PocketGSError: it is none, or holds no cameras of a run.
    """
    if not (named.exists() and holds_cameras(folder_of(named) / CAMERAS)):
        raise PocketGSError(f"{named}: expected a result folder, with {CAMERAS}")
    return folder_of(named)


def capture_of(scene: Path, capture: Path) -> Path:
    """A capture with poses: of photographs or a video, the one that training made of them in the scene's result folder.

    Args:
        scene: a scene file or a result folder.
        capture: as the user named it.
    """
    capture = video_of(capture)
    made = posed_folder(folder_of(scene), capture)
    return made if made.is_dir() and lacks_poses(capture) else capture


def load_scene(path: Path) -> Gaussians:
    """Read a scene file of any format, or the scene of a result folder, which is drawn sorted.

    Raises:
        PocketGSError: there is no readable scene, or it is drawn without sorting.
    """
    if is_sort_free(path):
        raise PocketGSError(f"{path}: a scene that is drawn without sorting, expected one that is sorted")
    if _holds(path, UNBUNDLED):
        raise PocketGSError(f"{path}: an unbundled SOG, expected a file: zip what is in the folder as a .sog")
    if not (path.exists() or is_scene_name(path)):
        raise PocketGSError(f"{path}: no such file or folder, expected a scene file or a result folder")
    return read_scene(path / SCENE if path.is_dir() else path)


def load_any(path: Path) -> AnyScene:
    """Read a scene, sorted or sort-free.

    Raises:
        PocketGSError: there is no readable scene.
    """
    return read_sort_free(path) if is_sort_free(path) else load_scene(path)


def without_broken(path: Path, gaussians: Gaussians) -> Gaussians:
    """The Gaussians without those that hold NaN or infinity, which are not drawn; a warning says how many."""
    finite = gaussians.is_finite
    return gaussians if _are_all(finite, path) else gaussians.select(finite)


def without_broken_weights(path: Path, scene: SortFreeScene) -> SortFreeScene:
    """A sort-free scene without the Gaussians that hold NaN or infinity, in their weights too; with a warning."""
    finite = scene.gaussians.is_finite & np.isfinite(scene.visibility_sh).all(axis=1)
    return scene if _are_all(finite, path) else edited(scene, lambda gaussians: gaussians.select(finite))


def _are_all(finite: np.ndarray, path: Path) -> bool:
    """Whether all Gaussians are finite; otherwise a warning says how many are not."""
    broken = int(np.count_nonzero(~finite))
    if broken:
        warn(path, f"{broken:,} of {len(finite):,} Gaussians hold NaN or infinity and are left out")
    return not broken


def drawn_by(path: Path, options: EngineOptions) -> tuple[Renderer, int]:
    """What draws a scene as it was trained, and its number of Gaussians: sorted, or without sorting.

    Raises:
        PocketGSError: there is no readable scene, or the engine is not available here.
    """
    scene = load_any(path)
    if isinstance(scene, SortFreeScene):
        return drawing_of(scene, options), len(scene)
    engine = create_engine(options)
    engine.upload(scene)
    return engine, len(scene)


def read_for(scene: Path, capture: Path, reading: CaptureOptions) -> Capture:
    """Read the capture of a scene, on the background of the scene's run unless the options have another.

    Args:
        scene: a scene file or a result folder, see `run_of`.
        capture: as the user named it.
        reading: options of the command.

    Raises:
        PocketGSError: the capture or a file of the result cannot be read.
    """
    known = trained_on(folder_of(scene))
    if known and reading.background is None:
        reading = replace(reading, background=known.background)
    return read_capture(capture_of(scene, capture), reading)


def check_unseen(scene: Path, capture: Capture) -> None:
    """Refuse held-out views that the scene's run was trained on: they cannot judge it.

    If the capture differs from that of the run in something else, a warning is printed.

    Raises:
        PocketGSError: there are such views, or a file of the result cannot be read.
    """
    known = trained_on(folder_of(scene))
    if not known:
        return
    if overlap := known.overlap(capture):
        raise PocketGSError(f"{scene}: {overlap}")
    if difference := known.difference(capture):
        warn(scene, difference)


def warn(scene: Path, warning: str) -> None:
    """Print a warning about a scene."""
    Terminal(to_errors=True).say(f"warning: {scene}: {warning}", style="yellow")


def in_world_of(path: Path, capture: Capture) -> Capture:
    """The capture with the poses that the scene was trained with, if they differ from the capture's.

    Without the photographs that the scene's run has left out; a warning names them. So does one say that the run of a
    lone file is unknown.

    Args:
        path: a scene file or a result folder, see `run_of`.
        capture: with its own poses.

    Raises:
        PocketGSError: they cannot be read.
    """
    cameras = folder_of(path) / CAMERAS
    if holds_cameras(cameras):
        return with_poses_of(capture, cameras, partial(warn, path))
    if not path.is_dir():
        warn(path, OWN_POSES)
    return capture


def as_trained_on(path: Path, capture: Capture) -> Capture:
    """The capture as `in_world_of` gives it, without the transients that the scene's run has found.

    If the run had other training views, its transients stay, and a warning is printed. So it is if views are held out
    that the run was trained on, or the capture differs from that of the run in something else.

    Raises:
        PocketGSError: poses or transients cannot be read.
    """
    capture = in_world_of(path, capture)
    if known := trained_on(folder_of(path)):
        if overlap := known.overlap(capture):
            warn(path, f"{overlap}; figures on these views are too good")
        elif difference := known.difference(capture):
            warn(path, difference)
    return without_transients_of(folder_of(path), capture, partial(warn, path))
