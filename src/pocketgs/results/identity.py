"""What must be equal between a checkpoint and the run that resumes from it."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from pocketgs.capture.capture import Capture, Frame
from pocketgs.results.checkpoint import INTRINSICS, MAX_GAUSSIANS, SEEDS, SH_DEGREE, SHRINK, TRAINING_CAMERAS
from pocketgs.training.options import SizedOptions
from pocketgs.training.planning.plan import Plan
from pocketgs.training.recipes import recipe_named

STEPS = 2.0**20
"""Rotations' elements, positions relative to the farthest, and intrinsics relative to the image's size count as equal
if they round to the same step.

A power of two, so that the numbers in files, which are decimal, do not lie halfway between two steps.
"""


def identity_of(capture: Capture, options: SizedOptions, plan: Plan) -> dict[str, Any]:
    """What must be equal between a checkpoint and the run that resumes from it.

    Args:
        capture: with the poses of its files.
        options: of the run.
        plan: of the run.
    """
    return {
        "capture": capture.name,
        "protocol": capture.protocol,
        "training views": len(capture.train),
        TRAINING_CAMERAS: digest_of_cameras(capture.train),
        INTRINSICS: digest_of_intrinsics(capture.train),
        "recipe": options.recipe,
        "seed": options.seed,
        SH_DEGREE: recipe_named(options.recipe).degree_for(options.sh_degree),
        "prior": options.prior,
        "bundle": options.bundle,
        "source views": options.source_views,
        "max keyframes": options.max_keyframes,
        "exposure": options.exposure,
        "max gaussians": options.max_gaussians,
        "strategy": options.strategy,
        SEEDS: options.seeds,
        SHRINK: plan.shrink,
        MAX_GAUSSIANS: plan.gaussians,
        "colours": options.colours,
        "transients": options.transients,
        # A run that trained as long as it paid may go on with a set length, but not the other way round.
        **({"open ended": True} if options.open_ended else {}),
    }


def digest_of_cameras(frames: Sequence[Frame]) -> str:
    """Digest of the names and the poses of frames, which does not depend on how a machine rounds."""
    digest = hashlib.sha256("\n".join(frame.name for frame in frames).encode("utf-8", "surrogateescape"))
    poses = np.array([frame.camera.world_to_camera[:3] for frame in frames]).reshape(-1, 3, 4)
    farthest = float(np.abs(poses[:, :, 3]).max(initial=0.0)) or 1.0
    poses[:, :, 3] /= farthest
    digest.update(np.rint(poses * STEPS).astype("<i8").tobytes())
    digest.update(str(round(256 * float(np.log2(farthest)))).encode())
    return digest.hexdigest()[:16]


def digest_of_intrinsics(frames: Sequence[Frame]) -> str:
    """Digest of the intrinsics of frames, relative to the size of their images, and of their lenses."""
    digest = hashlib.sha256()
    for camera in (frame.camera for frame in frames):
        numbers = [
            camera.fx / camera.width,
            camera.fy / camera.height,
            camera.cx / camera.width,
            camera.cy / camera.height,
        ]
        digest.update(camera.lens.model.encode())
        digest.update(np.rint(np.array([*numbers, *camera.lens.coefficients]) * STEPS).astype("<i8").tobytes())
    return digest.hexdigest()[:16]
