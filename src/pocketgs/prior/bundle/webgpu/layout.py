"""Numbers of the equations that shaders and host share."""

from __future__ import annotations

from pocketgs.prior.bundle.reprojection import CAMERA_UNKNOWNS, POINT_COLUMN, SHARED_UNKNOWNS

CAMERA_WORDS = 14
"""Of a camera: the rotation's rows, the centre, and both focal lengths."""

POINT_WORDS = 18
"""Of a point: see `shaders/common/blocks.wgsl`."""

COLUMNS = POINT_COLUMN + 1
"""Derivatives of a residual by the camera's unknowns and the shared ones, and the residual."""

COUPLING_WORDS = 3 * CAMERA_UNKNOWNS
"""Of an observation: its coupling of a camera's unknowns to a point's coordinates."""

SIGHT_WORDS = 2 * COLUMNS + COUPLING_WORDS
"""Of an observation: the columns of x and of y, and its coupling."""

PRODUCTS = POINT_COLUMN * COLUMNS
TAKEN = CAMERA_UNKNOWNS * (1 + SHARED_UNKNOWNS)
CAMERA_SUMS = PRODUCTS + TAKEN
"""Sums per camera: products of columns, and what eliminating the points takes."""

PAIR_SUMS = CAMERA_UNKNOWNS**2

SHARED_SUMS = 5
"""What eliminating the points takes from the shared unknowns: from the lower triangle of their block, and from their
right-hand side."""
