"""The geometry prior's numbers that the page has to know, as data."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from pocketgs.capture.sharpness import REDUCED_SIDE
from pocketgs.geometry import agreement
from pocketgs.prior import exposure, keyframes, scale, seen_points
from pocketgs.prior.bundle import levenberg_marquardt, reprojection
from pocketgs.prior.bundle.adjustment import BundleSettings
from pocketgs.prior.bundle.cpu.equations import MIN_DIAGONAL
from pocketgs.prior.cloud import complete, coverage, fuse, merge, visual_hull
from pocketgs.prior.cloud.cpu import merger
from pocketgs.prior.cloud.detail import DETAIL_SCALE
from pocketgs.prior.depth import depth_maps, depth_range, sensor_depth
from pocketgs.prior.depth.source_views import BASELINE_SPREAD, LEAST_PARALLAX, THIRD_VIEW
from pocketgs.prior.depth.sweep import MAX_PIXELS, SweepSettings
from pocketgs.prior.depth.webgpu.layout import MATCHED, MOST_BANDS, USABLE
from pocketgs.prior.features import features, pairs, two_view
from pocketgs.prior.features.tracks import REWEIGHTINGS, WIDEST_AXES_ANGLE
from pocketgs.prior.features.webgpu import layout
from pocketgs.prior.poses import (
    absolute_pose,
    consensus,
    convention,
    photometric,
    relocalisation,
    robust_adjustment,
    support,
    suspects,
    tolerance,
    validation,
)
from pocketgs.prior.poses.structure import MAX_STEPS, NEGLIGIBLE_GAIN, StructureSettings
from pocketgs.training.planning.effort import QUICK_KEYFRAMES


def prior_settings() -> dict[str, Any]:
    """The settings' `prior`: each group is that of the module of the same name, or of its stage."""
    return {**_sparse_points(), **_poses(), **_exposure(), **_keyframes(), **_depth(), **_cloud()}


def _sparse_points() -> dict[str, Any]:
    """Features, which views are matched, and which matches one motion explains."""
    return {
        "features": {
            "most": StructureSettings().features,
            "ratio": features.RATIO,
            "descriptor": features.DESCRIPTOR,
            "kernels": [kernel.tolist() for kernel in layout.kernels()],
            "octave_bytes": layout.OCTAVE_BYTES,
            "pixel_bytes": layout.PIXEL_BYTES,
            "other_bytes": layout.OTHER_BYTES,
        },
        "pairs": {
            "ranks": list(pairs.RANKS_BY_POSE),
            "steps": list(pairs.STEPS_IN_SEQUENCE),
            "widest_angle": float(WIDEST_AXES_ANGLE),
            "max_similar": pairs.MAX_SIMILAR,
            "words": pairs.WORDS,
        },
        "two_view": {
            "verification": two_view.VERIFICATION,
            "min_matches": two_view.MIN_MATCHES,
            "min_share": two_view.MIN_SHARE,
            "confidence": two_view.CONFIDENCE,
            "trials": two_view.TRIALS,
            "widest": tolerance.WIDEST,
        },
    }


def _poses() -> dict[str, Any]:
    """The scene's scale, wrong poses, and refined ones."""
    return {
        "scale": {
            "one_place": scale.ONE_PLACE,
            "metric_distance": scale.METRIC_DISTANCE,
        },
        "suspects": {
            "pair_fit": agreement.PAIR_FIT,
            "min_support": agreement.MIN_SUPPORT,
            "min_matches": suspects.MIN_MATCHES,
            "neighbours": suspects.NEIGHBOURS,
            "alike_pairs": suspects.ALIKE_PAIRS,
            "alike_share": suspects.ALIKE_SHARE,
            "max_chance": suspects.MAX_CHANCE,
            "min_features": suspects.MIN_FEATURES,
            "min_views": suspects.MIN_VIEWS,
            "min_main": suspects.MIN_MAIN,
        },
        "absolute_pose": {
            "min_observations": absolute_pose.MIN_OBSERVATIONS,
            "confidence": absolute_pose.CONFIDENCE,
            "trials": absolute_pose.TRIALS,
            "bundle": {"iterations": BundleSettings().iterations, "tolerance": BundleSettings().tolerance},
        },
        "relocalisation": {
            "rounds": relocalisation.ROUNDS,
            "more_similar": relocalisation.MORE_SIMILAR,
            "min_fit": relocalisation.MIN_FIT,
        },
        "poses": {
            "max_trials": consensus.MAX_TRIALS,
            "reweightings": REWEIGHTINGS,
            "min_angle": float(tolerance.MIN_ANGLE),
            "widest": tolerance.WIDEST,
            "medians": tolerance.MEDIANS,
            "finest": tolerance.FINEST,
            "tolerance_rounds": tolerance.ROUNDS,
            "checked_share": validation.CHECKED_SHARE,
            "left_out_share": validation.LEFT_OUT_SHARE,
            "min_gain": validation.MIN_GAIN,
            "rounds": robust_adjustment.ROUNDS,
            "observations_per_view": robust_adjustment.OBSERVATIONS_PER_VIEW,
            "min_observations": robust_adjustment.MIN_OBSERVATIONS,
            "photometric": {
                "radius": photometric.RADIUS,
                "step": photometric.STEP,
                "min_contrast": photometric.MIN_CONTRAST,
                "most": photometric.MOST,
            },
            "convention": {
                "doubtful": convention.DOUBTFUL,
                "clear": convention.CLEAR,
                "contradicted": convention.CONTRADICTED,
                "mostly": convention.MOSTLY,
                "mended": convention.MENDED,
                "min_matches": convention.MIN_MATCHES,
            },
            "cells": support.CELLS,
            "min_cells": support.MIN_CELLS,
            "min_views": validation.MIN_VIEWS,
            "fewest_points": StructureSettings().fewest_points,
            "bundle": _bundle(),
        },
    }


def _bundle() -> dict[str, Any]:
    """Bundle adjustment."""
    structure = StructureSettings()
    return {
        "huber": BundleSettings().huber,
        "iterations": MAX_STEPS,
        "tolerance": NEGLIGIBLE_GAIN,
        "position_sigma": structure.position_sigma,
        "rotation_sigma": float(structure.rotation_sigma),
        "grazing": reprojection.GRAZING,
        "behind": reprojection.BEHIND,
        "first_damping": levenberg_marquardt.FIRST_DAMPING,
        "min_damping": levenberg_marquardt.MIN_DAMPING,
        "min_diagonal": MIN_DIAGONAL,
        "negligible": levenberg_marquardt.NEGLIGIBLE,
    }


def _exposure() -> dict[str, Any]:
    """Gains of the photographs."""
    return {
        "exposure": {
            "darkest": exposure.DARKEST,
            "brightest": exposure.BRIGHTEST,
            "smoothing": exposure.SMOOTHING,
            "blur_radius": exposure.BLUR_RADIUS,
            "alternations": exposure.ALTERNATIONS,
            "settled": exposure.SETTLED,
            "min_points": exposure.MIN_POINTS,
            "enough_points": exposure.ENOUGH_POINTS,
            "most_points": exposure.MOST_POINTS,
            "neighbours": exposure.NEIGHBOURS,
            "min_variation": exposure.MIN_VARIATION,
            "predictable": exposure.PREDICTABLE,
        },
    }


def _keyframes() -> dict[str, Any]:
    """Frames whose depth is computed, by the points that they see."""
    return {
        "keyframes": {
            **asdict(keyframes.KeyframeSettings(max_keyframes=QUICK_KEYFRAMES)),
            "cells": keyframes.CELLS,
            "neighbouring_frames": keyframes.NEIGHBOURING_FRAMES,
            "hidden": keyframes.HIDDEN,
            "coarser": keyframes.COARSER,
            "widest_angle": float(keyframes.WIDEST_VIEWING_ANGLE),
            "max_views": keyframes.MAX_VIEWS,
            "least_parallax": LEAST_PARALLAX,
            "copied": keyframes.COPIED,
            "sharpness_side": REDUCED_SIDE,
        },
        "seen_points": {
            "max_points": seen_points.MAX_POINTS,
            "max_seen": seen_points.MAX_SEEN,
            "hidden": seen_points.HIDDEN,
        },
    }


def _depth() -> dict[str, Any]:
    """Depth maps of keyframes."""
    return {
        "depth_range": {
            "quantiles": depth_range.QUANTILES,
            "nearest_share": depth_range.NEAREST_SHARE,
            "nearest_quantile": depth_range.NEAREST_QUANTILE,
            "nearest_an_octave": depth_range.NEAREST_AN_OCTAVE,
            "limits_per_step": depth_range.LIMITS_PER_STEP,
            "unknown_nearest": depth_range.UNKNOWN_NEAREST,
            "min_points": depth_range.MIN_POINTS,
            "wide_hypotheses": depth_range.WIDE_HYPOTHESES,
            "wide_pixels": depth_range.WIDE_PIXELS,
            "widened": depth_range.WIDENED,
            "pixels_per_step": depth_range.PIXELS_PER_STEP,
            "fewest": depth_range.FEWEST,
            "most": depth_range.MOST,
        },
        "sweep": {
            **{name: float(value) for name, value in asdict(SweepSettings()).items()},
            "third_view": THIRD_VIEW,
            "least_parallax": LEAST_PARALLAX,
            "baseline_spread": BASELINE_SPREAD,
            "min_points": depth_maps.MIN_POINTS,
            "max_points": depth_maps.MAX_POINTS,
            "grid": depth_maps.GRID,
            "max_pixels": MAX_PIXELS,
            "max_swept_pixels": depth_maps.MAX_SWEPT_PIXELS,
            "sure_margin": sensor_depth.SURE_MARGIN,
            "most_hypotheses": depth_range.MOST,
            "most_bands": MOST_BANDS,
            "matched": MATCHED,
            "usable": USABLE,
        },
        "sensor_depth": {
            "weak_margin": sensor_depth.WEAK_MARGIN,
            "sure_margin": sensor_depth.SURE_MARGIN,
            "min_pixels": sensor_depth.MIN_PIXELS,
        },
    }


def _cloud() -> dict[str, Any]:
    """Fusion of the depth maps, and completion."""
    return {
        "fusion": {
            **asdict(fuse.FusionSettings()),
            "shell_extent": fuse.SHELL_EXTENT,
            "max_candidates": fuse.MAX_CANDIDATES,
            "judging_points": visual_hull.JUDGING_POINTS,
            "detail_scale": DETAIL_SCALE,
        },
        "merging": {
            "rounds": merge.MERGING_ROUNDS,
            "overfull": merge.OVERFULL,
            "turn": merge.TURN.ravel().tolist(),
            "detail_power": merge.DETAIL_POWER,
            "max_octaves": merge.MAX_OCTAVES,
            "min_detail": merge.MIN_DETAIL,
            "key_factors": [str(factor) for factor in merger.KEY_FACTORS],  # JSON's numbers have 53 bits
            "steps_an_octave": merge.STEPS_AN_OCTAVE,
            "sizes_an_octave": merge.SIZES_AN_OCTAVE,
        },
        "coverage": {
            "cells": coverage.CELLS,
            "neighbours": coverage.NEIGHBOURS,
            "widest_angle": float(coverage.WIDEST_COVERED_ANGLE),
            "largest": coverage.LARGEST,
            "missing_share": complete.MISSING_SHARE,
            "max_added_share": complete.MAX_ADDED_SHARE,
            "max_source": complete.MAX_SOURCE,
        },
    }
