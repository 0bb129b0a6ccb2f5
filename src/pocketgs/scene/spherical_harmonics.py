"""Real spherical harmonics up to degree 3 and their gradients with respect to the direction."""

from __future__ import annotations

import numpy as np

from pocketgs.scene.gaussians import SH_DC

C1 = 0.4886025119029199
C2 = (1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396)
C3 = (
    -0.5900435899266435,
    2.890611442640554,
    -0.4570457994644658,
    0.3731763325901154,
    -0.4570457994644658,
    1.445305721320277,
    -0.5900435899266435,
)


def basis(directions: np.ndarray, coefficients: int) -> np.ndarray:
    """Evaluate the first `coefficients` harmonics, in the order and with the signs of the reference 3DGS `.ply`.

    Args:
        directions: (N, 3) unit vectors from the camera to the Gaussians.
        coefficients: K = 1, 4, 9 or 16.

    Returns:
        (N, K).
    """
    x, y, z = directions.T
    values = [np.full_like(x, SH_DC)]
    if coefficients > 1:
        values += [-C1 * y, C1 * z, -C1 * x]
    if coefficients > 4:
        xx, yy, zz = x * x, y * y, z * z
        values += [C2[0] * x * y, C2[1] * y * z, C2[2] * (2 * zz - xx - yy), C2[3] * x * z, C2[4] * (xx - yy)]
    if coefficients > 9:
        values += [
            C3[0] * y * (3 * xx - yy),
            C3[1] * x * y * z,
            C3[2] * y * (4 * zz - xx - yy),
            C3[3] * z * (2 * zz - 3 * xx - 3 * yy),
            C3[4] * x * (4 * zz - xx - yy),
            C3[5] * z * (xx - yy),
            C3[6] * x * (xx - 3 * yy),
        ]
    return np.stack(values, axis=1)


def basis_gradient(directions: np.ndarray, coefficients: int) -> np.ndarray:
    """(N, K, 3) derivatives of `basis` with respect to x, y and z, treated as independent."""
    x, y, z = directions.T
    o = np.zeros_like(x)
    rows = [(o, o, o)]
    if coefficients > 1:
        c1 = np.full_like(x, C1)
        rows += [(o, -c1, o), (o, o, c1), (-c1, o, o)]
    if coefficients > 4:
        rows += [
            (C2[0] * y, C2[0] * x, o),
            (o, C2[1] * z, C2[1] * y),
            (-2 * C2[2] * x, -2 * C2[2] * y, 4 * C2[2] * z),
            (C2[3] * z, o, C2[3] * x),
            (2 * C2[4] * x, -2 * C2[4] * y, o),
        ]
    if coefficients > 9:
        xx, yy, zz = x * x, y * y, z * z
        rows += [
            (6 * C3[0] * x * y, C3[0] * (3 * xx - 3 * yy), o),
            (C3[1] * y * z, C3[1] * x * z, C3[1] * x * y),
            (-2 * C3[2] * x * y, C3[2] * (4 * zz - xx - 3 * yy), 8 * C3[2] * y * z),
            (-6 * C3[3] * x * z, -6 * C3[3] * y * z, C3[3] * (6 * zz - 3 * xx - 3 * yy)),
            (C3[4] * (4 * zz - 3 * xx - yy), -2 * C3[4] * x * y, 8 * C3[4] * x * z),
            (2 * C3[5] * x * z, -2 * C3[5] * y * z, C3[5] * (xx - yy)),
            (C3[6] * (3 * xx - 3 * yy), -6 * C3[6] * x * y, o),
        ]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)
