"""Preparation: refined poses and initial points, before training."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np

from pocketgs.capture.capture import Capture
from pocketgs.capture.pinhole_copy import frames_at, has_lenses, without_lenses
from pocketgs.errors import PocketGSError
from pocketgs.prior.advice import check_photographs
from pocketgs.prior.cloud.volume import draw_points
from pocketgs.prior.depth.sweep import SweepSettings
from pocketgs.prior.devices import Devices, create_devices
from pocketgs.prior.exposure import compensated
from pocketgs.prior.keyframes import KeyframeSettings
from pocketgs.prior.poses.structure import StructureSettings
from pocketgs.prior.prior import PreparedCapture, PriorSettings, build_prior
from pocketgs.scene.point_cloud import PointCloud
from pocketgs.splat.choose_engine import chosen_engine
from pocketgs.structure_from_motion.process import check_installed
from pocketgs.structure_from_motion.sparse_cloud import triangulate
from pocketgs.system.cores import kernel_threads
from pocketgs.system.stopwatch import Stopwatch
from pocketgs.training.options import SizedOptions, TrainingOptions
from pocketgs.training.planning.effort import sized
from pocketgs.training.random_points import points_in_a_cube
from pocketgs.training.recipes import recipe_named

MIN_POINTS = 16
"""Minimum number of points to start from."""


def prepare(
    capture: Capture,
    options: TrainingOptions | None = None,
    stopwatch: Stopwatch | None = None,
    devices: Devices | None = None,
) -> PreparedCapture:
    """Build the prior selected by the options.

    Without one, or if a sparse one finds too few points, the capture's own points are used, or random points where the
    photographs agree.

    Args:
        capture: to train on.
        options: None for the defaults.
        stopwatch: times the stages; None for a new one.
        devices: compute the prior; None for what the options name.

    Raises:
        PocketGSError: there is no training view, there are too few photographs, or there is nothing to start from.
    """
    if not capture.train:
        raise PocketGSError(f"{capture.path}: no training view, expected at least one")
    if has_lenses(capture):
        return _prepared_through_lenses(capture, options or TrainingOptions(), stopwatch, devices)
    check_photographs(capture)
    options = sized(options or TrainingOptions(), [(f.camera.width, f.camera.height) for f in capture.train])
    stopwatch = stopwatch or Stopwatch()
    prepared = PreparedCapture.of(capture, None)
    if options.prior == "colmap" and (capture.points is None or options.bundle):
        # The capture's own cloud does not fit poses that have been refined.
        check_installed()
    if options.prior != "none":
        numba.set_num_threads(kernel_threads(options.threads))
        devices = devices or devices_of(options)
        prepared = build_prior(capture, options.most_at_start, _settings(options), stopwatch, devices)
        if options.prior == "colmap":
            prepared = _with_colmap_cloud(capture, prepared, options, stopwatch)
        if prepared.points and len(prepared.points) >= MIN_POINTS:
            return _with_points(prepared, at_most(prepared.points, options.most_at_start, options.seed))
    with stopwatch.stage("points"):
        points = starting_points(replace(prepared, points=capture.points), options)
    report = prepared.report
    if report is not None:
        found = f"too few points were found ({report.points}): training starts from other points"
        report = replace(report, warnings=(*report.warnings, found))
    return replace(prepared, points=points, report=report)


def devices_of(options: TrainingOptions) -> Devices:
    """What computes the prior: the device of the engine that the options choose.

    Raises:
        PocketGSError: there is no such device.
    """
    return create_devices(chosen_engine(options.engine_options), options.gpu, options.max_memory)


def _prepared_through_lenses(
    capture: Capture, options: TrainingOptions, stopwatch: Stopwatch | None, devices: Devices | None
) -> PreparedCapture:
    """The prior of undistorted copies, with the original photographs: the prior needs pinhole cameras."""
    found = prepare(without_lenses(capture), options, stopwatch, devices)
    train, held_out = frames_at(capture.train, found.train), frames_at(capture.held_out, found.held_out)
    if found.report is not None and found.report.gains is not None:
        train = compensated(train, found.report.gains)
    return replace(found, train=train, held_out=held_out)


def _with_points(prepared: PreparedCapture, points: PointCloud) -> PreparedCapture:
    """Replace the cloud, and record it in the report."""
    report = replace(prepared.report, points=len(points)) if prepared.report else None
    return replace(prepared, points=points, report=report)


def _with_colmap_cloud(
    capture: Capture, prepared: PreparedCapture, options: SizedOptions, stopwatch: Stopwatch
) -> PreparedCapture:
    """Replace a sparse cloud: by the capture's if its poses are unchanged, otherwise by COLMAP's."""
    assert prepared.report is not None
    with stopwatch.stage("points"):
        points = None if prepared.report.poses_refined else capture.points
        if points is None:
            points = triangulate(prepared.train, options.seed)
    return _with_points(prepared, points)


def starting_points(capture: Capture, options: SizedOptions) -> PointCloud:
    """The capture's own points, or random ones if it has none; at most the maximum number at the start."""
    if capture.points is None or len(capture.points) < 4:
        random_points = recipe_named(options.recipe).random_points
        if random_points is not None:
            count = min(random_points, options.most_at_start)
            return points_in_a_cube([frame.camera for frame in capture.train], count, options.seed)
        return draw_points(capture.train, options.most_at_start, options.seed)
    return at_most(capture.points, options.most_at_start, options.seed)


def at_most(points: PointCloud, most: int, seed: int) -> PointCloud:
    """The points, or a random sample of them if there are more than `most`."""
    if len(points) <= most:
        return points
    chosen = np.random.default_rng(seed).permutation(len(points))[:most]
    return points.select(np.sort(chosen))


def _settings(options: SizedOptions) -> PriorSettings:
    return PriorSettings(
        keyframes=KeyframeSettings(max_keyframes=options.max_keyframes),
        structure=StructureSettings(bundle=options.bundle),
        sweep=SweepSettings(source_views=options.source_views),
        dense=options.prior == "dense",
        exposure=options.exposure,
    )
