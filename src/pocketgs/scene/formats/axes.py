"""Formats whose axes point the other way than those of the 3DGS `.ply`, which are x right, y down, z forward.

All that is needed are half turns, which change signs and lose nothing.
"""

from __future__ import annotations

import numpy as np

from pocketgs.scene.gaussians import Gaussians

RIGHT_UP_BACK = (1, -1, -1)
"""Signs that take x right, y down, z forward to x right, y up, z back, and return: the axes of `.spz`."""

LEFT_UP_FORWARD = (-1, -1, 1)
"""Signs that take x right, y down, z forward to x left, y up, z forward, and return: the axes of glTF."""

# Which of x, y and z a harmonic is odd in, in the order of the 3DGS `.ply`: Y(-x, y, z) = -Y(x, y, z) for "x".
_ODD = ("", "y", "z", "x", "xy", "yz", "", "xz", "", "y", "xyz", "y", "z", "x", "z", "x")


def half_turn(gaussians: Gaussians, signs: tuple[int, int, int]) -> Gaussians:
    """The scene in axes two of which point the other way.

    Args:
        gaussians: the scene.
        signs: of x, y and z; two are -1.
    """
    x, y, z = signs
    flips = dict(zip("xyz", signs, strict=True))
    harmonics = np.array([np.prod([flips[axis] for axis in odd]) for odd in _ODD], np.float32)
    return Gaussians(
        gaussians.means * np.array(signs, np.float32),
        gaussians.log_scales,
        gaussians.quaternions * np.array([1, y * z, x * z, x * y], np.float32),
        gaussians.opacity_logits,
        gaussians.sh * harmonics[: gaussians.sh.shape[1], None],
    )
