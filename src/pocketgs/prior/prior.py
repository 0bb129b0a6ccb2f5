"""Operator G: from a capture alone to refined poses and a dense, clean, coloured cloud."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from pocketgs.capture.capture import Capture, Frame
from pocketgs.pointcloud import PointCloud
from pocketgs.prior.depth_range import depth_range
from pocketgs.prior.exposure import compensated, exposure_gains, needs_compensation
from pocketgs.prior.fuse import FusionSettings, fuse
from pocketgs.prior.gate import GateSettings, choose_keyframes
from pocketgs.prior.relocalise import relocalise
from pocketgs.prior.report import PriorReport
from pocketgs.prior.scale import Scale, estimate_scale
from pocketgs.prior.sensor_depth import completed
from pocketgs.prior.structure import Structure, StructureSettings, build_structure
from pocketgs.prior.sweep import DepthMap, SweepSettings, at_sweep_size, choose_references, sweep
from pocketgs.record import Stopwatch

Exposure = Literal["auto", "on", "off"]


@dataclass(frozen=True)
class PriorSettings:
    """How the prior is built.

    Attributes:
        gate, structure, sweep, fusion: of the stages.
        dense: match pixels; otherwise the cloud is that of the sparse points.
        exposure: bring the training photographs to one exposure: always, never, or where similar views differ.
    """

    gate: GateSettings = field(default_factory=GateSettings)
    structure: StructureSettings = field(default_factory=StructureSettings)
    sweep: SweepSettings = field(default_factory=SweepSettings)
    fusion: FusionSettings = field(default_factory=FusionSettings)
    dense: bool = True
    exposure: Exposure = "auto"


@dataclass(frozen=True)
class Prior:
    """What training starts from.

    Attributes:
        capture: with the poses, photographs and points to train on.
        report: how it came about, or None if the capture was taken as it is.
    """

    capture: Capture
    report: PriorReport | None


def build_prior(
    capture: Capture, max_points: int, settings: PriorSettings | None = None, stopwatch: Stopwatch | None = None
) -> Prior:
    """Build the geometry prior.

    A capture with too little texture keeps its poses; depths are then searched in a range that only the cameras tell.

    Args:
        capture: posed frames; its own points are not looked at.
        max_points: bound on the cloud.
        settings: how; all at their defaults if None.
        stopwatch: times the stages; a new one if None.
    """
    settings = settings or PriorSettings()
    stopwatch = stopwatch or Stopwatch()
    with stopwatch.stage("keyframes"):
        scale = estimate_scale(capture)
        decisions = choose_keyframes(capture.train, scale, settings.gate)

    def keyframes_of(frames: Sequence[Frame]) -> list[Frame]:
        return [frame for frame, decision in zip(frames, decisions, strict=True) if decision.kept]

    with stopwatch.stage("poses"):
        given = keyframes_of(capture.train)
        structure = build_structure(given, scale, settings.structure)
        capture, carried = _with_refined_poses(capture, given, structure, scale, settings)
        capture, gains = _with_one_exposure(capture, keyframes_of(capture.train), structure, scale, settings)
    if settings.dense:
        with stopwatch.stage("depth"):
            frames = [at_sweep_size(frame) for frame in capture.train]
            keyframes = keyframes_of(frames)
            maps = _depth_maps(keyframes, frames, structure, scale, settings.sweep)
        with stopwatch.stage("fusion"):
            cloud = fuse(keyframes, maps, capture.train, max_points, settings.fusion)
    else:
        cloud = _sparse_cloud(keyframes_of(capture.train), structure, max_points)
    report = PriorReport(
        decisions=decisions,
        sparse_points=len(structure.points) if structure else 0,
        rmse_given=structure.rmse_before if structure else None,
        rmse=structure.rmse_after if structure else None,
        poses_refined=structure is not None and structure.refined,
        carried=carried,
        gains=gains,
        points=len(cloud),
        warnings=_warnings(structure, carried),
    )
    return Prior(replace(capture, points=cloud), report)


def _with_refined_poses(
    capture: Capture, keyframes: Sequence[Frame], structure: Structure | None, scale: Scale, settings: PriorSettings
) -> tuple[Capture, tuple[str, ...]]:
    """The capture in the world that bundle adjustment made, and which frames could not be placed in it by sight."""
    if structure is None or not structure.refined:
        return capture, ()
    cameras = {frame.name: camera for frame, camera in zip(keyframes, structure.cameras, strict=True)}
    others = [frame for frame in capture.frames if frame.name not in cameras]
    found = relocalise(others, keyframes, structure, scale, settings.structure)
    cameras |= {frame.name: camera for frame, camera in zip(others, found.cameras, strict=True)}
    return capture.with_refined_poses(cameras), found.carried


def _with_one_exposure(
    capture: Capture, keyframes: Sequence[Frame], structure: Structure | None, scale: Scale, settings: PriorSettings
) -> tuple[Capture, tuple[float, float] | None]:
    """The capture with its training photographs at one exposure if need be, and the range of their gains."""
    if structure is None or settings.exposure == "off":
        return capture, None
    gains = exposure_gains(capture.train, keyframes, structure, scale)
    if settings.exposure == "auto" and not needs_compensation(capture.train, gains, scale):
        return capture, None
    return replace(capture, train=compensated(capture.train, gains)), (float(gains.min()), float(gains.max()))


def _depth_maps(
    keyframes: Sequence[Frame],
    frames: Sequence[Frame],
    structure: Structure | None,
    scale: Scale,
    settings: SweepSettings,
) -> list[DepthMap]:
    maps = []
    for view, keyframe in enumerate(keyframes):
        points = structure.points[structure.landmarks[view][1]] if structure else np.zeros((0, 3))
        nearest, farthest = depth_range(keyframe.camera, points, scale.distance)
        middle = 2 / (1 / nearest + 1 / farthest)
        references = choose_references(keyframe, frames, middle, settings)
        found = sweep(keyframe, references, nearest, farthest, settings)
        maps.append(completed(found, keyframe))
    return maps


def _sparse_cloud(keyframes: Sequence[Frame], structure: Structure | None, most: int) -> PointCloud:
    """The triangulated points, `most` of them, each with the colour of a feature that it was seen as."""
    if structure is None:
        return PointCloud(np.zeros((0, 3)), np.zeros((0, 3)))
    colours = np.zeros((len(structure.points), 3), np.float32)
    for keyframe, (features, point) in zip(keyframes, structure.landmarks, strict=True):
        columns, rows = features.pixels.astype(np.int64).T
        colours[point] = keyframe.image[rows, columns] / np.float32(255)
    finite = np.flatnonzero(np.isfinite(structure.points).all(axis=1))
    chosen = finite[np.linspace(0, len(finite) - 1, min(most, len(finite))).astype(np.int64)]
    return PointCloud(structure.points, colours).select(chosen)


def _warnings(structure: Structure | None, carried: tuple[str, ...]) -> tuple[str, ...]:
    found = []
    if structure is None:
        found.append("too little texture to refine poses or to tell how far things are: poses are used as given")
    if carried:
        found.append(
            f"{len(carried)} frames see too little to be placed exactly and follow their neighbours: "
            + ", ".join(carried[:5])
            + (", ..." if len(carried) > 5 else "")
        )
    return tuple(found)
