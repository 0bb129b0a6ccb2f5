"""The geometry prior: from a capture to refined poses and a dense coloured cloud."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, fields, replace
from typing import Literal

import numpy as np

from pocketgs.capture.capture import Capture, Frame
from pocketgs.capture.pinhole_copy import has_lenses
from pocketgs.errors import PocketGSError
from pocketgs.prior.advice import exposure_hint, nothing_found, photograph_hints, poses_hint
from pocketgs.prior.cloud.fuse import FusionSettings
from pocketgs.prior.dense_cloud import SparseScene, dense_cloud
from pocketgs.prior.depth.sweep import SweepSettings
from pocketgs.prior.devices import Devices, create_devices
from pocketgs.prior.exposure import compensated, exposure_gains, needs_compensation, undone_gains
from pocketgs.prior.keyframes import KeyframeSettings, select_keyframes
from pocketgs.prior.poses.convention import Convention, MisreadPosesError
from pocketgs.prior.poses.structure import Structure, StructureSettings, build_structure
from pocketgs.prior.report import PoseReport, PriorReport
from pocketgs.prior.rough_points import rough_points
from pocketgs.prior.scale import Scale, estimate_scale
from pocketgs.prior.seen_points import seen_points
from pocketgs.scene.point_cloud import PointCloud
from pocketgs.system.stopwatch import Stopwatch

Exposure = Literal["auto", "on", "off"]


@dataclass(frozen=True)
class PriorSettings:
    """Settings of the prior.

    Attributes:
        keyframes, structure, sweep, fusion: of the stages.
        dense: compute depth maps; otherwise the cloud consists of the sparse points.
        exposure: compensate exposure differences of the training photographs: always, never, or where similar views
            differ.
    """

    keyframes: KeyframeSettings = field(default_factory=KeyframeSettings)
    structure: StructureSettings = field(default_factory=StructureSettings)
    sweep: SweepSettings = field(default_factory=SweepSettings)
    fusion: FusionSettings = field(default_factory=FusionSettings)
    dense: bool = True
    exposure: Exposure = "auto"


@dataclass(frozen=True)
class PreparedCapture(Capture):
    """A capture with the poses, photographs and points for training.

    Attributes:
        report: how they were made, or None if the capture is used as it is.
    """

    report: PriorReport | None = None

    @staticmethod
    def of(capture: Capture, report: PriorReport | None) -> PreparedCapture:
        """A prepared capture that is used as it is."""
        return PreparedCapture(**{each.name: getattr(capture, each.name) for each in fields(Capture)}, report=report)


def build_prior(
    capture: Capture,
    max_points: int,
    settings: PriorSettings | None = None,
    stopwatch: Stopwatch | None = None,
    devices: Devices | None = None,
) -> PreparedCapture:
    """Build the geometry prior.

    A capture with too little texture keeps its poses; what its frames see then follows from its own points, or if it
    has none from sweeps of small copies.

    Args:
        capture: posed frames; its own points fill gaps.
        max_points: maximum size of the cloud.
        settings: None for the defaults.
        stopwatch: times the stages; None for a new one.
        devices: what computes the stages; None for the CPU.

    Raises:
        PocketGSError: a frame's camera has a lens, or the photographs contradict the poses as a whole.
    """
    if has_lenses(capture):
        raise PocketGSError(f"prior of {capture.name}: found cameras with lenses, expected what without_lenses gives")
    settings = settings or PriorSettings()
    stopwatch = stopwatch or Stopwatch()
    devices = devices or create_devices()
    hints = photograph_hints(capture.frames)
    with stopwatch.stage("poses"):
        capture, scale, structure, poses = _posed(capture, settings.structure, devices)
        capture, gains = _with_one_exposure(capture, structure, scale, settings)
    seen = _seen_points(structure, capture)
    if settings.dense and not any(map(len, seen)):
        with stopwatch.stage("depth"):
            seen = rough_points(capture.train, scale.distance, settings.sweep, devices.stereo)
    with stopwatch.stage("keyframes"):
        decisions = select_keyframes(capture.train, seen, scale.distance, settings.keyframes)
    cloud, dense = _sparse_cloud(capture.train, structure), None
    if settings.dense:
        # The capture's own cloud is in the world of its original poses.
        own = [capture.points] if capture.points and not (structure and structure.adjusted) else []
        kept = [index for index, decision in enumerate(decisions) if decision.kept]
        scene = SparseScene(capture.train, kept, seen, [cloud, *own], scale.distance)
        dense = dense_cloud(scene, max_points, settings.sweep, settings.fusion, devices, stopwatch)
        cloud, hints = dense.points, (*hints, *dense.warnings)
    report = PriorReport(
        decisions=decisions,
        sparse_points=len(structure.points) if structure else 0,
        rmse_given=structure.rmse_before if structure else None,
        rmse=structure.rmse_after if structure else None,
        poses_refined=bool(poses.convention) or (structure is not None and structure.refined),
        poses=poses,
        gains=None if gains is None else undone_gains(capture.train, gains),
        points=len(cloud),
        swept_on=dense.swept_on if dense else None,
        coverage=dense.completion.covered if dense else None,
        coverage_known=dense.completion.known if dense else None,
        guessed=dense.completion.guessed if dense else 0,
        warnings=(*hints, *exposure_hint(gains), *_pose_warnings(poses, structure, capture, scale)),
    )
    return PreparedCapture.of(replace(capture, points=cloud), report)


def _posed(
    capture: Capture, settings: StructureSettings, devices: Devices
) -> tuple[Capture, Scale, Structure | None, PoseReport]:
    """The capture with sound poses, its scale, what its training frames see, and what happened to the poses."""

    def built(capture: Capture, scale: Scale) -> Structure | None:
        return build_structure(capture.frames, scale, settings, capture.photographs, devices.finder, devices.linearizer)

    scale, convention = estimate_scale(capture), None
    with ExitStack() as held:
        held.callback(devices.finder.release)
        held.callback(devices.linearizer.release)
        try:
            structure = built(capture, scale)
        except MisreadPosesError as error:
            if not settings.bundle:
                raise
            convention = error.convention
            capture = _reread(capture, convention)
            scale = estimate_scale(capture)
            structure = built(capture, scale)
    capture = _with_poses_of(structure, capture)
    poses = PoseReport.of(structure, capture, convention)
    return capture, scale, structure.restricted_to(capture.train) if structure else None, poses


def _reread(capture: Capture, convention: Convention) -> Capture:
    """The capture with poses read in another convention."""
    capture = capture.with_refined_poses({frame.name: convention.applied(frame.camera) for frame in capture.frames})
    # Inverted transforms lead to another world than that of the capture's points.
    return replace(capture, points=None) if convention.inverted else capture


def _pose_warnings(poses: PoseReport, structure: Structure | None, capture: Capture, scale: Scale) -> tuple[str, ...]:
    """Warnings about the poses."""
    if structure is None:
        return (nothing_found(capture, scale),)
    frames = len(capture.frames) + len(poses.left_out)
    return (*poses_hint(len(poses.contradicted), frames), *poses.warnings())


def _with_poses_of(structure: Structure | None, capture: Capture) -> Capture:
    """The capture with the structure's poses, without training frames whose wrong poses could not be corrected."""
    if structure is None:
        return capture
    if structure.refined:
        capture = capture.with_refined_poses(dict(zip(structure.names, structure.cameras, strict=True)))
    sound = [frame for frame in capture.train if frame.name not in structure.unplaced]
    return capture if len(sound) == len(capture.train) else replace(capture, train=sound)


def _with_one_exposure(
    capture: Capture, structure: Structure | None, scale: Scale, settings: PriorSettings
) -> tuple[Capture, np.ndarray | None]:
    """The capture with exposure-compensated training photographs if needed, and the gains of all of them."""
    if structure is None or settings.exposure == "off":
        return capture, None
    gains = exposure_gains(capture.train, structure, scale)
    if settings.exposure == "auto" and not needs_compensation(capture.train, gains, scale):
        return capture, None
    return replace(capture, train=compensated(capture.train, gains)), gains


def _seen_points(structure: Structure | None, capture: Capture) -> list[np.ndarray]:
    """For each training frame, (N, 3) the sparse points that it sees; without any, those of the capture's own cloud."""
    if structure is not None:
        return [structure.points[seen.point] for seen in structure.by_frame()]
    if capture.points is not None:
        return seen_points(capture.points, capture.train)
    return [np.zeros((0, 3))] * len(capture.train)


def _sparse_cloud(frames: Sequence[Frame], structure: Structure | None) -> PointCloud:
    """The triangulated points, each with the colour of one of its features and the direction to that camera."""
    if structure is None:
        return PointCloud(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)))
    colours, directions = np.zeros((2, len(structure.points), 3))
    for frame, seen in zip(frames, structure.by_frame(), strict=True):
        columns, rows = seen.pixels.astype(np.int64).T
        colours[seen.point] = frame.image[rows, columns] / np.float32(255)
        away = frame.camera.centre - structure.points[seen.point]
        directions[seen.point] = away / np.linalg.norm(away, axis=1, keepdims=True)
    finite = np.isfinite(structure.points).all(axis=1)
    return PointCloud(structure.points, colours, directions).select(finite)
