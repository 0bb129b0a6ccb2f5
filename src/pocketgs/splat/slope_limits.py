"""Where the linearised projection is held: what lies far outside the image would make it explode."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.geometry.lens import Lens, undistort
from pocketgs.splat.constants import FRUSTUM_MARGIN

_SAMPLES = 17


def slope_limits(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """(2,) least and (2,) largest x/z and y/z at which the Jacobian is evaluated: the image and a margin.

    A pinhole's are gsplat's. A lens's are those that the same pixels show through it.
    """
    size = np.array([camera.width, camera.height])
    focal, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    low, high = -(centre + FRUSTUM_MARGIN * size) / focal, (size - centre + FRUSTUM_MARGIN * size) / focal
    if camera.is_pinhole:
        return low, high
    return _through(camera.lens, tuple(low), tuple(high))


@lru_cache(maxsize=64)
def _through(lens: Lens, low: tuple[float, float], high: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """The least and largest coordinates of what a lens shows in a rectangle."""
    sides = [np.linspace(*ends, _SAMPLES) for ends in zip(low, high, strict=True)]
    seen = undistort(lens, np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2))
    return seen.min(axis=0), seen.max(axis=0)
