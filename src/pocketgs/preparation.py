"""Before training: the capture with the poses, photographs and points to train on."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np

from pocketgs.capture.capture import Capture
from pocketgs.cores import kernel_threads
from pocketgs.errors import PocketGSError
from pocketgs.planning.effort import sized
from pocketgs.pointcloud import PointCloud
from pocketgs.prior.advice import check_photographs
from pocketgs.prior.keyframes import KeyframeSettings
from pocketgs.prior.prior import Prior, PriorSettings, build_prior
from pocketgs.prior.structure import StructureSettings
from pocketgs.prior.sweep import SweepSettings
from pocketgs.record import Stopwatch
from pocketgs.structure_from_motion.process import check_installed
from pocketgs.structure_from_motion.sparse_cloud import triangulate
from pocketgs.training_options import SizedOptions, TrainingOptions
from pocketgs.volume import draw_points

FEWEST_POINTS = 16
"""A cloud of fewer is not worth starting from."""


def prepare(capture: Capture, options: TrainingOptions | None = None, stopwatch: Stopwatch | None = None) -> Prior:
    """Build the prior that the options ask for.

    Where none is asked for, or a sparse one finds hardly a point, the capture's own points are taken, or points drawn
    where the photographs agree.

    Args:
        capture: what to train on.
        options: of the run; all at their defaults if None.
        stopwatch: times the stages; a new one if None.

    Raises:
        PocketGSError: there is no training view, there are too few photographs, or there is nothing to start from.
    """
    if not capture.train:
        raise PocketGSError(f"{capture.path}: no training view, expected at least one")
    check_photographs(capture)
    options = sized(options or TrainingOptions(), [(f.camera.width, f.camera.height) for f in capture.train])
    stopwatch = stopwatch or Stopwatch()
    prior = Prior(capture, None)
    if options.prior == "colmap" and capture.points is None:
        check_installed()
    if options.prior != "none":
        numba.set_num_threads(kernel_threads(options.threads))
        prior = build_prior(capture, options.max_gaussians, _settings(options), stopwatch)
        if options.prior == "colmap":
            prior = _with_colmap_cloud(capture, prior, options, stopwatch)
        if prior.capture.points and len(prior.capture.points) >= FEWEST_POINTS:
            return _with_points(prior, _at_most(prior.capture.points, options))
    with stopwatch.stage("points"):
        points = starting_points(replace(prior.capture, points=capture.points), options)
    report = prior.report
    if report is not None:
        found = f"too few points were found ({report.points}): training starts from others"
        report = replace(report, warnings=(*report.warnings, found))
    return Prior(replace(prior.capture, points=points), report)


def _with_points(prior: Prior, points: PointCloud) -> Prior:
    """The prior with another cloud, of which its report tells too."""
    report = replace(prior.report, points=len(points)) if prior.report else None
    return Prior(replace(prior.capture, points=points), report)


def _with_colmap_cloud(capture: Capture, prior: Prior, options: SizedOptions, stopwatch: Stopwatch) -> Prior:
    """The prior with a sparse cloud in place of its own: the capture's where its poses still hold, or COLMAP's."""
    assert prior.report is not None
    with stopwatch.stage("points"):
        points = None if prior.report.poses_refined else capture.points
        if points is None:
            points = triangulate(prior.capture.train, options.seed)
    return _with_points(prior, points)


def starting_points(capture: Capture, options: SizedOptions) -> PointCloud:
    """The capture's own points, or points drawn where it has none; at most `max_gaussians` of them."""
    if capture.points is None or len(capture.points) < 4:
        return draw_points(capture.train, options.max_gaussians, options.seed)
    return _at_most(capture.points, options)


def _at_most(points: PointCloud, options: SizedOptions) -> PointCloud:
    if len(points) <= options.max_gaussians:
        return points
    chosen = np.random.default_rng(options.seed).permutation(len(points))[: options.max_gaussians]
    return points.select(np.sort(chosen))


def _settings(options: SizedOptions) -> PriorSettings:
    return PriorSettings(
        keyframes=KeyframeSettings(max_keyframes=options.max_keyframes),
        structure=StructureSettings(bundle=options.bundle),
        sweep=SweepSettings(references=options.references),
        dense=options.prior == "dense",
        exposure=options.exposure,
    )
