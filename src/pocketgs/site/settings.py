"""Python's numbers that the page has to know, as data: the recipe, a run's sizes, constants of readers and seeds."""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import Any

import numpy as np

from pocketgs.capture import plain_background
from pocketgs.capture.decoding.cloud_file import LARGEST_FRACTION, UNKNOWN_COLOUR
from pocketgs.capture.formats.colmap import IMAGE_FOLDERS, MODEL_FOLDERS, MODELS_BESIDE
from pocketgs.capture.formats.colmap_model import CAMERA_MODELS, UNSUPPORTED_MODELS
from pocketgs.capture.formats.polycam import UNDISTORTION_BORDER
from pocketgs.capture.formats.transforms_file import (
    DEFAULT_DEPTH_UNIT,
    EXTENSIONS_TRIED,
    FISHEYE_MODELS,
    LENSES_OF_INSTANT_NGP,
    PERSPECTIVE_MODELS,
)
from pocketgs.capture.frame_parts import ASPECT_TOLERANCE, PLANE_ASPECT_TOLERANCE
from pocketgs.capture.hold_out import FEWEST_TO_HOLD_OUT, HOLD_OUT_EVERY
from pocketgs.capture.masks import FOLDERS
from pocketgs.capture.named_images import DEEPEST
from pocketgs.capture.origin import EXTENT_SHARE, FAR, METRIC_EXTENT, ONE_POINT
from pocketgs.capture.poses import (
    ARKIT_PIXEL_CENTRE,
    MAX_COORDINATE,
    MAX_INTRINSIC,
    MIN_FOCAL_LENGTH,
    ROTATION_TOLERANCE,
)
from pocketgs.capture.sharpness import MAX_FRAMES, REDUCED_SIDE
from pocketgs.capture.undistortion import BORDER_SAMPLES
from pocketgs.capture.unposed import POSED_RECORD, USUAL_FOLDER
from pocketgs.files.paths import OTHER_PICTURES
from pocketgs.geometry.camera_geometry import GUESSED_DISTANCE, MIN_CONVERGENCE
from pocketgs.geometry.lens import MAX_HALF_FIELD, MAX_STEP
from pocketgs.prior.cloud import visual_hull, volume
from pocketgs.scene.formats import pgs_rounding
from pocketgs.scene.formats.pgs_coding import FINE
from pocketgs.scene.formats.spz_arrangement import AXES, RENAMINGS
from pocketgs.scene.gaussians import SH_COEFFICIENTS
from pocketgs.scene.morton import BITS
from pocketgs.seeding.seeds import THICKNESS
from pocketgs.seeding.webgpu.layout import LEAF, MOST_NEIGHBOURS
from pocketgs.site.prior_settings import prior_settings
from pocketgs.splat.constants import SSIM_WINDOW
from pocketgs.splat.engine import KEPT_LOSSES
from pocketgs.splat.settings import LearningRates
from pocketgs.splat.webgpu.engine import INTERSECTION_BYTES
from pocketgs.splat.webgpu.memory import (
    EXPECTED_PER_GAUSSIAN,
    EXPECTED_PER_PIXEL,
    GROWTH,
    INTERSECTIONS_PER_GAUSSIAN,
    MIN_INTERSECTIONS,
)
from pocketgs.splat.webgpu.steps_ahead import MAX_PENDING, MAX_STREAMED, SECONDS_AHEAD
from pocketgs.splat.webgpu.variant import Variant
from pocketgs.training.dropout import ENOUGH_VIEWS, FEW_VIEWS, MOST_POINTS
from pocketgs.training.options import TrainingOptions
from pocketgs.training.planning.effort import QUICK_GAUSSIANS, QUICK_ITERATIONS
from pocketgs.training.preparation import MIN_POINTS
from pocketgs.training.recipes import MOST_DEPTHS, RECIPES, SLOWEST_SCALES, Recipe, Schedule

RECIPE = "pocketgs"

MOST_MEMORY = 1000
"""Megabytes that the page takes at most, unless the user allows more: phones end pages that take a little more."""

LEAST_SIDE, LEAST_GAUSSIANS = 320, 5_000
"""A run that does not fit is reduced to photographs of such a longest side, and then to so many Gaussians."""

PGS_CODING = FINE.finer().finer().finer().finer()
"""The grids of the `.pgs` that the page saves: as close to the trained scene as its `.spz`, and smaller."""

SCHEDULE_SAMPLES = 256
"""A schedule is stated at so many equal parts of a run; between them the page interpolates."""


def settings() -> dict[str, Any]:
    """The content of `settings.json`."""
    return {
        "run": {
            "iterations": QUICK_ITERATIONS,
            "gaussians": QUICK_GAUSSIANS,
            "evaluate_every": TrainingOptions().evaluate_every,
            "hold_out_every": HOLD_OUT_EVERY,
            "fewest_to_hold_out": FEWEST_TO_HOLD_OUT,
            "min_points": MIN_POINTS,
            "seed": TrainingOptions().seed,
        },
        "plan": {"most_memory": MOST_MEMORY, "least_side": LEAST_SIDE, "least_gaussians": LEAST_GAUSSIANS},
        "recipe": _recipe(RECIPES[RECIPE]),
        "engine": _engine(),
        "capture": _capture(),
        "seeding": {
            "leaf": LEAF,
            "most_neighbours": MOST_NEIGHBOURS,
            "thickness": THICKNESS,
            "morton_bits": BITS,
        },
        "volume": _volume(),
        "prior": prior_settings(),
        "pgs": _pgs(),
    }


def _engine() -> dict[str, Any]:
    """How the engine's host makes room in buffers, and how far ahead of the GPU it submits steps."""
    return {
        "ssim_window": SSIM_WINDOW,
        "kept_losses": KEPT_LOSSES,
        "intersections_per_gaussian": INTERSECTIONS_PER_GAUSSIAN,
        "min_intersections": MIN_INTERSECTIONS,
        "expected_per_gaussian": EXPECTED_PER_GAUSSIAN,
        "expected_per_pixel": EXPECTED_PER_PIXEL,
        "intersection_bytes": INTERSECTION_BYTES[Variant().accumulation],
        "growth": GROWTH,
        "most_ahead": MAX_PENDING,
        "streamed_ahead": MAX_STREAMED,
        "seconds_ahead": SECONDS_AHEAD,
    }


def _capture() -> dict[str, Any]:
    """What readers of captures look for, and what they refuse."""
    return {
        "camera_models": [
            {"number": number, "name": model.name, "parameters": model.parameters, "fisheye": model.fisheye}
            for number, model in CAMERA_MODELS.items()
        ],
        "unsupported_models": [{"number": number, "parameters": count} for number, count in UNSUPPORTED_MODELS.items()],
        "model_folders": MODEL_FOLDERS,
        "models_beside": MODELS_BESIDE,
        "image_folders": IMAGE_FOLDERS,
        "usual_images": USUAL_FOLDER,
        "posed_record": POSED_RECORD,
        "perspective_models": PERSPECTIVE_MODELS,
        "fisheye_models": FISHEYE_MODELS,
        "other_lenses": LENSES_OF_INSTANT_NGP,
        "extensions_tried": EXTENSIONS_TRIED,
        "mask_folders": FOLDERS,
        "other_pictures": OTHER_PICTURES,
        "deepest": DEEPEST,
        "arkit_pixel_centre": ARKIT_PIXEL_CENTRE,
        "undistortion_border": UNDISTORTION_BORDER,
        "depth_unit": DEFAULT_DEPTH_UNIT,
        "max_frames": MAX_FRAMES,
        "sharpness_side": REDUCED_SIDE,
        "aspect_tolerance": ASPECT_TOLERANCE,
        "plane_aspect_tolerance": PLANE_ASPECT_TOLERANCE,
        "rotation_tolerance": ROTATION_TOLERANCE,
        "max_coordinate": MAX_COORDINATE,
        "max_intrinsic": MAX_INTRINSIC,
        "min_focal_length": MIN_FOCAL_LENGTH,
        "far": FAR,
        "extent_share": EXTENT_SHARE,
        "one_point": ONE_POINT,
        "largest_fraction": LARGEST_FRACTION,
        "metric_extent": METRIC_EXTENT,
        "plain_background": {"like": plain_background.LIKE, "least_share": plain_background.LEAST_SHARE},
        "unknown_colour": UNKNOWN_COLOUR,
        "border_samples": BORDER_SAMPLES,
        "max_half_field": MAX_HALF_FIELD,
        "max_step": MAX_STEP,
    }


def _volume() -> dict[str, Any]:
    """Points in the volume that cameras see together, for a capture without a cloud."""
    return {
        "nearest": volume.NEAREST,
        "farthest": volume.FARTHEST,
        "depths": volume.DEPTHS,
        "neighbours": volume.NEIGHBOURS,
        "best_angle": float(volume.BEST_ANGLE),
        "patch": volume.PATCH.tolist(),
        "kept": volume.KEPT,
        "min_points": volume.MIN_POINTS,
        "judging_points": visual_hull.JUDGING_POINTS,
        "min_convergence": MIN_CONVERGENCE,
        "guessed_distance": GUESSED_DISTANCE,
    }


def _pgs() -> dict[str, Any]:
    """How the page writes a `.pgs`."""
    return {
        "coding": asdict(PGS_CODING.in_single_precision()),
        "grid_bits": pgs_rounding.GRID_BITS,
        "max_level": pgs_rounding.MAX_LEVEL,
        "max_logit": pgs_rounding.MAX_LOGIT,
        "renamings": [
            {"quaternion": renaming, "axes": axes}
            for renaming, axes in zip(RENAMINGS.tolist(), AXES.tolist(), strict=True)
        ],
    }


def _recipe(recipe: Recipe) -> dict[str, Any]:
    return {
        "name": recipe.name,
        "rates": asdict(recipe.rates),
        "schedule": _sampled(recipe.schedule),
        "scales_for": recipe.scales_for,
        "slowest_scales": SLOWEST_SCALES,
        "most_depths": MOST_DEPTHS,
        "loss": asdict(recipe.loss),
        "adam": asdict(recipe.adam),
        "opacity": recipe.opacity,
        "seed_size": recipe.seed_size,
        "dropout": {
            "most": recipe.dropout,
            "few_views": FEW_VIEWS,
            "enough_views": ENOUGH_VIEWS,
            "most_points": MOST_POINTS,
        },
        "coefficients": SH_COEFFICIENTS[recipe.sh_degree],
    }


def _sampled(schedule: Schedule) -> dict[str, list[float]]:
    """By what the schedule multiplies each of the rates, from a run's start to its end."""
    names = [field.name for field in fields(LearningRates)]
    ones = LearningRates(*[1.0] * len(names))
    samples = [asdict(schedule(ones, progress)) for progress in np.linspace(0.0, 1.0, SCHEDULE_SAMPLES + 1).tolist()]
    # More decimals would make the site larger, and the interpolation no better.
    return {name: [round(rates[name], 7) for rates in samples] for name in names}
