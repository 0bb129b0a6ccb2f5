"""Numbers of the equations that shaders and host share."""

from __future__ import annotations

from pocketgs.prior.bundle.reprojection import CAMERA_UNKNOWNS

CAMERA_WORDS = 14
"""Of a camera: the rotation's rows, the centre, and both focal lengths."""

POINT_WORDS = 12
"""Of a point: see `shaders/common/blocks.wgsl`."""

COLUMNS = CAMERA_UNKNOWNS + 1
"""Derivatives of a residual by the camera's unknowns, and the residual."""

COUPLING_WORDS = 3 * CAMERA_UNKNOWNS
"""Of an observation: its coupling of a camera's unknowns to a point's coordinates."""

SIGHT_WORDS = 2 * COLUMNS + COUPLING_WORDS
"""Of an observation: the columns of x and of y, and its coupling."""

PRODUCTS = CAMERA_UNKNOWNS * COLUMNS
CAMERA_SUMS = PRODUCTS + CAMERA_UNKNOWNS
"""Sums per camera: products of columns, and what eliminating the points takes from the right-hand side."""

PAIR_SUMS = CAMERA_UNKNOWNS**2
