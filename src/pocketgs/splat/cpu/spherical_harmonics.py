"""Real spherical harmonics for kernels; see `scene/spherical_harmonics.py` for the order and signs."""

from __future__ import annotations

import numpy as np

from pocketgs.scene.gaussians import SH_DC
from pocketgs.scene.spherical_harmonics import C1, C2, C3
from pocketgs.system.compile import inlined, part


@part
def sh_basis(x: float, y: float, z: float, count: int, values: np.ndarray) -> None:
    """Write the first `count` (1, 4, 9 or 16) harmonics of the unit vector (x, y, z) to `values`."""
    values[0] = SH_DC
    if count > 1:
        values[1], values[2], values[3] = -C1 * y, C1 * z, -C1 * x
    if count > 4:
        xx, yy, zz = x * x, y * y, z * z
        values[4], values[5] = C2[0] * x * y, C2[1] * y * z
        values[6] = C2[2] * (2 * zz - xx - yy)
        values[7], values[8] = C2[3] * x * z, C2[4] * (xx - yy)
        if count > 9:
            values[9] = C3[0] * y * (3 * xx - yy)
            values[10] = C3[1] * x * y * z
            values[11] = C3[2] * y * (4 * zz - xx - yy)
            values[12] = C3[3] * z * (2 * zz - 3 * xx - 3 * yy)
            values[13] = C3[4] * x * (4 * zz - xx - yy)
            values[14] = C3[5] * z * (xx - yy)
            values[15] = C3[6] * x * (xx - 3 * yy)


@inlined
def _set(row: np.ndarray, x: float, y: float, z: float) -> None:
    row[0], row[1], row[2] = x, y, z


@part
def sh_basis_gradient(x: float, y: float, z: float, count: int, rows: np.ndarray) -> None:
    """Write the derivatives of the first `count` harmonics along x, y and z to the rows of `rows`."""
    _set(rows[0], 0.0, 0.0, 0.0)
    if count > 1:
        _set(rows[1], 0.0, -C1, 0.0)
        _set(rows[2], 0.0, 0.0, C1)
        _set(rows[3], -C1, 0.0, 0.0)
    if count > 4:
        _set(rows[4], C2[0] * y, C2[0] * x, 0.0)
        _set(rows[5], 0.0, C2[1] * z, C2[1] * y)
        _set(rows[6], -2 * C2[2] * x, -2 * C2[2] * y, 4 * C2[2] * z)
        _set(rows[7], C2[3] * z, 0.0, C2[3] * x)
        _set(rows[8], 2 * C2[4] * x, -2 * C2[4] * y, 0.0)
    if count > 9:
        xx, yy, zz = x * x, y * y, z * z
        _set(rows[9], 6 * C3[0] * x * y, C3[0] * (3 * xx - 3 * yy), 0.0)
        _set(rows[10], C3[1] * y * z, C3[1] * x * z, C3[1] * x * y)
        _set(rows[11], -2 * C3[2] * x * y, C3[2] * (4 * zz - xx - 3 * yy), 8 * C3[2] * y * z)
        _set(rows[12], -6 * C3[3] * x * z, -6 * C3[3] * y * z, C3[3] * (6 * zz - 3 * xx - 3 * yy))
        _set(rows[13], C3[4] * (4 * zz - 3 * xx - yy), -2 * C3[4] * x * y, 8 * C3[4] * x * z)
        _set(rows[14], 2 * C3[5] * x * z, -2 * C3[5] * y * z, C3[5] * (xx - yy))
        _set(rows[15], C3[6] * (3 * xx - 3 * yy), -6 * C3[6] * x * y, 0.0)
