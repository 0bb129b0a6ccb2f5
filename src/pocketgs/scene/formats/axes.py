"""Conversion to formats with other axes than the 3DGS `.ply`, which has x right, y down, z forward.

All conversions are half turns, which change signs and lose nothing.
"""

from __future__ import annotations

import numpy as np

from pocketgs.scene.gaussians import Gaussians

RIGHT_DOWN_FORWARD = (1, 1, 1)
"""Signs that convert between axes that are the same."""

RIGHT_UP_BACK = (1, -1, -1)
"""Signs that convert between x right, y down, z forward and x right, y up, z back, the axes of `.spz`."""

LEFT_UP_FORWARD = (-1, -1, 1)
"""Signs that convert between x right, y down, z forward and x left, y up, z forward, the axes of glTF."""

LEFT_DOWN_BACK = (-1, 1, -1)
"""Signs that convert between x right, y down, z forward and x left, y down, z back."""

# The coordinates in which each harmonic is odd, in the order of the 3DGS `.ply`: Y(-x, y, z) = -Y(x, y, z) for "x".
_ODD = ("", "y", "z", "x", "xy", "yz", "", "xz", "", "y", "xyz", "y", "z", "x", "z", "x")


def half_turn(gaussians: Gaussians, signs: tuple[int, int, int]) -> Gaussians:
    """Flip two of the scene's axes.

    Args:
        gaussians: the scene.
        signs: of x, y and z; two are -1, or none.
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
