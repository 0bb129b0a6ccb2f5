"""The `.splat` of antimatter15's viewer: 32 bytes per Gaussian, no header, no spherical harmonics above degree 0.

A record is the centre and the standard deviations (float32), then red, green, blue and opacity, then w, x, y, z of the
rotation as 128 + 128 q (uint8). Viewers draw the file while it loads, so the largest and most opaque Gaussians come
first.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.files.atomic_file import replacing
from pocketgs.geometry.quaternions import unit
from pocketgs.scene.formats.activations import colour_of, dc_of, opacity_from_byte, opacity_to_byte, to_byte
from pocketgs.scene.formats.checks import read_contents, require_room, require_sound
from pocketgs.scene.gaussians import Gaussians

RECORD = np.dtype([("means", "<f4", 3), ("scales", "<f4", 3), ("colours", "u1", 4), ("quaternions", "u1", 4)])
MIN_SCALE = np.finfo(np.float32).tiny
# Maximum bytes that reading takes per Gaussian and per spherical-harmonics coefficient, as measured.
READING = (200, 0)

ZERO, STEPS = 128, 128
"""Byte that encodes 0 in a rotation, and the number of steps to 1."""


def write_gaussians(path: Path, gaussians: Gaussians) -> None:
    """Write a scene atomically, largest size times opacity first; spherical harmonics above degree 0 are dropped.

    Raises:
        PocketGSError: the scene is empty or holds NaN or infinity, or the file cannot be written.
    """
    require_sound(path, gaussians)
    ordered = gaussians.select(np.argsort(-_log_importance(gaussians), kind="stable"))
    records = np.empty(len(ordered), RECORD)
    records["means"] = ordered.means
    with np.errstate(over="ignore"):
        records["scales"] = np.clip(ordered.scales, MIN_SCALE, np.finfo(np.float32).max)
    records["colours"][:, :3] = to_byte(colour_of(ordered.sh[:, 0]) * 255)
    records["colours"][:, 3] = opacity_to_byte(ordered.opacity_logits)
    records["quaternions"] = to_byte(unit(ordered.quaternions) * STEPS + ZERO)
    with replacing(path) as partial:
        partial.write_bytes(records.tobytes())


def _log_importance(gaussians: Gaussians) -> np.ndarray:
    """(N,) logarithms of volume times opacity."""
    return gaussians.log_scales.sum(axis=1, dtype=np.float64) - np.logaddexp(0.0, -gaussians.opacity_logits)


def read_gaussians(path: Path) -> Gaussians:
    """Read a scene.

    Raises:
        PocketGSError: the file is missing, is not a whole number of records, or holds NaN, infinity or negative scales.
    """
    contents = read_contents(path)
    if not contents or len(contents) % RECORD.itemsize:
        expected = f"a multiple of {RECORD.itemsize}, one record per Gaussian"
        raise PocketGSError(f"{path}: not a complete .splat: {len(contents)} bytes, expected {expected}")
    require_room(path, len(contents) // RECORD.itemsize, 1, READING)
    records = np.frombuffer(contents, RECORD)
    if np.any(records["scales"] < 0):
        raise PocketGSError(f"{path}: not a .splat: negative scales, expected standard deviations")
    # NaN and infinity are checked later, on the complete scene.
    with np.errstate(invalid="ignore"):
        log_scales = np.log(np.maximum(records["scales"], MIN_SCALE))
    gaussians = Gaussians(
        records["means"],
        log_scales,
        unit(records["quaternions"].astype(np.float32) - ZERO),
        opacity_from_byte(records["colours"][:, 3]),
        dc_of(records["colours"][:, None, :3] / 255),
    )
    require_sound(path, gaussians)
    return gaussians
