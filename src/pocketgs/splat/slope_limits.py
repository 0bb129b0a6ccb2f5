"""Bounds of the slopes at which the projection is linearised: far outside the image it would explode."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.geometry.lens import KEPT_LENSES, Lens, undistort
from pocketgs.splat.constants import FRUSTUM_MARGIN

_SAMPLES = 17


def slope_limits(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """(2,) minimum and (2,) maximum of x/z and y/z at which the Jacobian is evaluated: the image and a margin.

    They are gsplat's for a pinhole; for a lens, those of the same pixels.
    """
    size = np.array([camera.width, camera.height])
    focal, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    low, high = -(centre + FRUSTUM_MARGIN * size) / focal, (size - centre + FRUSTUM_MARGIN * size) / focal
    if camera.is_pinhole:
        return low, high
    return _through(camera.lens, tuple(low), tuple(high))


@lru_cache(maxsize=KEPT_LENSES)
def _through(lens: Lens, low: tuple[float, float], high: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Minimum and maximum of the undistorted coordinates of a rectangle."""
    sides = [np.linspace(*ends, _SAMPLES) for ends in zip(low, high, strict=True)]
    seen = undistort(lens, np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2))
    return seen.min(axis=0), seen.max(axis=0)
