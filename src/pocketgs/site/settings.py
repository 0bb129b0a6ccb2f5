"""Python's numbers that the page has to know, as data: the recipe, a run's sizes, constants of readers and seeds."""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import Any

import numpy as np

from pocketgs.capture.cloud_file import UNKNOWN_COLOUR
from pocketgs.capture.colmap import DEFAULT_IMAGES, IMAGE_FOLDERS, MODEL_FOLDERS
from pocketgs.capture.colmap_model import CAMERA_MODELS
from pocketgs.capture.loading import ASPECT_TOLERANCE
from pocketgs.capture.origin import FAR
from pocketgs.capture.poses import MAX_COORDINATE, MAX_INTRINSIC, MIN_FOCAL_LENGTH, ROTATION_TOLERANCE
from pocketgs.capture.transforms_file import EXTENSIONS_TRIED, FISHEYE_MODELS, PERSPECTIVE_MODELS
from pocketgs.capture.undistortion import BORDER_SAMPLES
from pocketgs.geometry.camera_geometry import GUESSED_DISTANCE, MIN_CONVERGENCE
from pocketgs.geometry.lens import MAX_HALF_FIELD, MAX_STEP
from pocketgs.prior import volume
from pocketgs.scene.gaussians import SH_COEFFICIENTS
from pocketgs.scene.morton import BITS
from pocketgs.splat.constants import SSIM_WINDOW
from pocketgs.splat.engine import KEPT_LOSSES
from pocketgs.splat.settings import LearningRates
from pocketgs.splat.webgpu.engine import INTERSECTION_BYTES
from pocketgs.splat.webgpu.memory import GROWTH, INTERSECTIONS_PER_GAUSSIAN, MIN_INTERSECTIONS
from pocketgs.splat.webgpu.passes import Variant
from pocketgs.splat.webgpu.steps_ahead import MAX_PENDING, SECONDS_AHEAD
from pocketgs.training.options import TrainingOptions
from pocketgs.training.planning.effort import QUICK_GAUSSIANS, QUICK_ITERATIONS
from pocketgs.training.recipes import RECIPES, SLOWEST_SCALES, Recipe, Schedule
from pocketgs.training.seeding import PLANE_NEIGHBOURS, SPACING_NEIGHBOURS, THICKNESS

RECIPE = "pocketgs"

HOLD_OUT_EVERY = 8
"""Every eighth photograph by name is held out, unless the capture has a split of its own."""

PACES = 256
"""A schedule is stated at so many equal parts of a run; between them the page interpolates."""


def settings() -> dict[str, Any]:
    """The content of `settings.json`."""
    return {
        "run": {
            "iterations": QUICK_ITERATIONS,
            "gaussians": QUICK_GAUSSIANS,
            "evaluate_every": TrainingOptions().evaluate_every,
            "hold_out_every": HOLD_OUT_EVERY,
            "seed": TrainingOptions().seed,
        },
        "recipe": _recipe(RECIPES[RECIPE]),
        "engine": {
            "ssim_window": SSIM_WINDOW,
            "kept_losses": KEPT_LOSSES,
            "intersections_per_gaussian": INTERSECTIONS_PER_GAUSSIAN,
            "min_intersections": MIN_INTERSECTIONS,
            "intersection_bytes": INTERSECTION_BYTES[Variant().accumulation],
            "growth": GROWTH,
            "most_ahead": MAX_PENDING,
            "seconds_ahead": SECONDS_AHEAD,
        },
        "capture": {
            "camera_models": [
                {"number": number, "name": model.name, "parameters": model.parameters, "fisheye": model.fisheye}
                for number, model in CAMERA_MODELS.items()
            ],
            "model_folders": MODEL_FOLDERS,
            "image_folders": IMAGE_FOLDERS,
            "usual_images": DEFAULT_IMAGES,
            "perspective_models": PERSPECTIVE_MODELS,
            "fisheye_models": FISHEYE_MODELS,
            "extensions_tried": EXTENSIONS_TRIED,
            "aspect_tolerance": ASPECT_TOLERANCE,
            "rotation_tolerance": ROTATION_TOLERANCE,
            "max_coordinate": MAX_COORDINATE,
            "max_intrinsic": MAX_INTRINSIC,
            "min_focal_length": MIN_FOCAL_LENGTH,
            "far": FAR,
            "unknown_colour": UNKNOWN_COLOUR,
            "border_samples": BORDER_SAMPLES,
            "max_half_field": MAX_HALF_FIELD,
            "max_step": MAX_STEP,
        },
        "seeding": {
            "spacing_neighbours": SPACING_NEIGHBOURS,
            "plane_neighbours": PLANE_NEIGHBOURS,
            "thickness": THICKNESS,
            "morton_bits": BITS,
        },
        "volume": {
            "nearest": volume.NEAREST,
            "farthest": volume.FARTHEST,
            "depths": volume.DEPTHS,
            "neighbours": volume.NEIGHBOURS,
            "best_angle": float(volume.BEST_ANGLE),
            "patch": volume.PATCH.tolist(),
            "kept": volume.KEPT,
            "min_points": volume.MIN_POINTS,
            "min_convergence": MIN_CONVERGENCE,
            "guessed_distance": GUESSED_DISTANCE,
        },
    }


def _recipe(recipe: Recipe) -> dict[str, Any]:
    return {
        "name": recipe.name,
        "rates": asdict(recipe.rates),
        "schedule": _sampled(recipe.schedule),
        "scales_for": recipe.scales_for,
        "slowest_scales": SLOWEST_SCALES,
        "loss": asdict(recipe.loss),
        "adam": asdict(recipe.adam),
        "opacity": recipe.opacity,
        "seed_size": recipe.seed_size,
        "coefficients": SH_COEFFICIENTS[recipe.sh_degree],
    }


def _sampled(schedule: Schedule) -> dict[str, list[float]]:
    """By what the schedule multiplies each of the rates, from a run's start to its end."""
    names = [field.name for field in fields(LearningRates)]
    ones = LearningRates(*[1.0] * len(names))
    paces = [asdict(schedule(ones, progress)) for progress in np.linspace(0.0, 1.0, PACES + 1).tolist()]
    return {name: [rates[name] for rates in paces] for name in names}
