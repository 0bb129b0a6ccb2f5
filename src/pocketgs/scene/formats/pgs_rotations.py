"""The grid of rotations of a `.pgs`.

A Gaussian's axes are named so that z is the one that differs most from the other two, and x is at least as long as y.
Its rotation is then a turn about z, the twist, followed by a turn that tilts z, the swing:

    q = (1 + p i + r j) (1 + t k), normalised,

with |t| <= 1 and p² + r² <= 1, since half turns about an axis show nothing. The more two axes differ in length, the
finer are the steps of a turn between them: the difference of log scales states how often they are halved.
"""

from __future__ import annotations

import numpy as np

from pocketgs.geometry.quaternions import composed, unit
from pocketgs.scene.formats.spz_arrangement import AXES, RENAMINGS

# Log ratios of two axes at which the steps of a turn between them are halved; the largest steps are 2^COARSEST units.
HALVINGS = np.array([0.06, 0.12, 0.25, 0.5, 1.0, 2.0, 4.0])
COARSEST = 4
MAX_TURN = 1 << 16


def fineness_of(log_scales: np.ndarray) -> np.ndarray:
    """(N, 3) how often the steps of p, r and t are halved, of (N, 3) rounded log scales."""
    x, y, z = log_scales.astype(np.float64).T
    swing = np.searchsorted(HALVINGS, np.maximum(np.abs(x - z), np.abs(y - z)), side="right")
    return np.stack([swing, swing, np.searchsorted(HALVINGS, np.abs(x - y), side="right")], axis=1)


def steps_of(log_scales: np.ndarray, unit_step: float) -> np.ndarray:
    """(N, 3) steps of p, r and t, of (N, 3) rounded log scales."""
    return np.ldexp(unit_step, COARSEST - fineness_of(log_scales))


def turns_of(quaternions: np.ndarray) -> np.ndarray:
    """(N, 3) float64 p, r, t of unit quaternions."""
    w, x, y, z = quaternions.T
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y, t = x / w, y / w, z / w
        both = 1.0 + t * t
        return np.stack([(x - t * y) / both, (y + t * x) / both, t], axis=1)


def quaternions_of(turns: np.ndarray) -> np.ndarray:
    """(N, 4) float32 unit quaternions of p, r, t."""
    p, r, t = turns.T
    x, y = p + r * t, r - p * t
    length = np.sqrt(1.0 + x * x + y * y + t * t)
    return np.stack([1.0 / length, x / length, y / length, t / length], axis=1).astype(np.float32)


def with_named_axes(log_scales: np.ndarray, quaternions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Name the axes of ellipsoids in the order of the format.

    Returns:
        (N, 3) index of the old axis that each new one is, and (N, 4) unit quaternions.
    """
    order = np.argsort(-log_scales, axis=1, kind="stable")
    longest, middle, shortest = np.take_along_axis(log_scales, order, axis=1).T
    is_needle = longest - middle > middle - shortest
    order[is_needle] = order[is_needle][:, [1, 2, 0]]
    turned = unit(quaternions)
    best, best_cost = np.zeros(len(order), np.int64), np.full(len(order), np.inf)
    for index, (renaming, axes) in enumerate(zip(RENAMINGS, AXES, strict=True)):
        p, r, t = turns_of(composed(turned, renaming)).T
        cost = np.nan_to_num(np.maximum(np.abs(t), np.hypot(p, r)), nan=np.inf)
        cost = np.where((order == axes).all(axis=1), cost, np.inf)
        best[cost < best_cost] = index
        best_cost = np.minimum(cost, best_cost)
    named = composed(turned, RENAMINGS[best])
    return AXES[best], named * np.where(named[:, :1] < 0, -1.0, 1.0)


def turn_levels(quaternions: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """(N, 3) multiples of the steps nearest to the p, r, t of unit quaternions; 0 where these are not finite."""
    turns = np.nan_to_num(turns_of(quaternions.astype(np.float64)), nan=0.0, posinf=0.0, neginf=0.0)
    return np.clip(np.rint(turns / steps), -MAX_TURN, MAX_TURN).astype(np.int64)
