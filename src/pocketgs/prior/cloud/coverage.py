"""Coverage: the parts of the training views that a cloud covers.

A cell of a view is covered if a point projects to it that was seen from about the same side, with a size from the
distance to its neighbours. Points on the far side of a wall do not cover it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numba import prange
from scipy.spatial import cKDTree

from pocketgs.capture.capture import Frame
from pocketgs.scene.point_cloud import PointCloud
from pocketgs.system.compile import parallel_kernel
from pocketgs.system.cores import usable_cores

CELLS = 96
"""Number of cells along the longer side of a view."""

NEIGHBOURS = 3
"""A point's radius is the mean distance to this many nearest neighbours."""

WIDEST_COVERED_ANGLE = np.radians(75)
"""Maximum angle between a point's own viewing direction and that of a view that it covers."""

LARGEST = 6.0
"""Maximum radius of a point in cells: an isolated point says nothing about its surroundings."""


@dataclass(frozen=True, eq=False)
class ViewCells:
    """Training views as grids of cells.

    Attributes:
        sizes: (V, 2) int64 rows and columns of each view's grid.
        intrinsics: (V, 4) float64 fx, fy, cx, cy in cells.
        rotations, translations, centres: (V, 3, 3), (V, 3), (V, 3) float64, world to camera, and camera centres.
        usable: (V, R, C) bool, padded to one size: cells inside the view that are not masked.
        colours: (V, R, C, 3) uint8 mean colours.
    """

    sizes: np.ndarray
    intrinsics: np.ndarray
    rotations: np.ndarray
    translations: np.ndarray
    centres: np.ndarray
    usable: np.ndarray
    colours: np.ndarray

    @staticmethod
    def of(frames: Sequence[Frame]) -> ViewCells:
        """The cells of some frames."""
        sizes: list[tuple[int, int]] = []
        scaled: list[tuple[float, ...]] = []
        for frame in frames:
            camera = frame.camera
            rows, columns = camera.grid_shape(CELLS)
            across, down = columns / camera.width, rows / camera.height
            sizes.append((rows, columns))
            scaled.append((camera.fx * across, camera.fy * down, camera.cx * across, camera.cy * down))
        shape = (len(frames), max(rows for rows, _ in sizes), max(columns for _, columns in sizes))
        usable, colours = np.zeros(shape, bool), np.zeros((*shape, 3), np.uint8)
        for view, (frame, (rows, columns)) in enumerate(zip(frames, sizes, strict=True)):
            colours[view, :rows, :columns] = cv2.resize(frame.image, (columns, rows), interpolation=cv2.INTER_AREA)
            usable[view, :rows, :columns] = True
            if frame.usable is not None:
                used = cv2.resize(frame.usable.astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA)
                usable[view, :rows, :columns] = used > 0.5
        poses = np.array([frame.camera.world_to_camera for frame in frames])
        return ViewCells(
            np.array(sizes, np.int64),
            np.array(scaled),
            np.ascontiguousarray(poses[:, :3, :3]),
            np.ascontiguousarray(poses[:, :3, 3]),
            np.array([frame.camera.centre for frame in frames]),
            usable,
            colours,
        )

    def empty(self) -> np.ndarray:
        """(V, R, C) float32 depths of uncovered cells: infinite."""
        return np.full(self.usable.shape, np.inf, np.float32)

    def cover(self, depths: np.ndarray, points: PointCloud, radii: np.ndarray) -> None:
        """Splat points into the depths of the cells that they cover, where they are nearer.

        Args:
            depths: (V, R, C) float32, updated.
            points: with or without directions.
            radii: (N,) in world units.
        """
        directions = np.zeros((len(points), 3), np.float32) if points.directions is None else points.directions
        _cover(
            points.positions.astype(np.float64),
            directions,
            np.asarray(radii, np.float64),
            self.sizes,
            self.intrinsics,
            self.rotations,
            self.translations,
            self.centres,
            float(np.cos(WIDEST_COVERED_ANGLE)),
            depths,
        )

    def cells_of(
        self, view: int, positions: np.ndarray
    ) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray], np.ndarray]:
        """Where a view shows positions.

        Returns:
            (N,) bool whether it does, and for those (M,) rows and columns of their cells, and (M,) depths.
        """
        rows, columns = self.sizes[view]
        fx, fy, cx, cy = self.intrinsics[view]
        x, y, z = (positions @ self.rotations[view].T + self.translations[view]).T
        before = z > 0
        safe = np.where(before, z, 1.0)
        column, row = np.floor(fx * x / safe + cx), np.floor(fy * y / safe + cy)
        inside = before & (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        return inside, (row[inside].astype(np.int64), column[inside].astype(np.int64)), z[inside]

    def share(self, depths: np.ndarray) -> float:
        """Share of covered cells among usable ones."""
        covered = np.isfinite(depths[self.usable])
        return float(covered.mean()) if len(covered) else 0.0

    def uncovered_share(self, depths: np.ndarray, positions: np.ndarray) -> np.ndarray:
        """(N,) share of the views showing a position in which its cell is uncovered; 0 if no view shows it."""
        shares = np.zeros(len(positions))
        bare = self.usable & ~np.isfinite(depths)
        positions = positions.astype(np.float64)
        _count(positions, self.sizes, self.intrinsics, self.rotations, self.translations, self.usable, bare, shares)
        return shares


def point_radii(positions: np.ndarray) -> np.ndarray:
    """(N,) mean distance of each point to its nearest neighbours."""
    if len(positions) <= NEIGHBOURS:
        return np.zeros(len(positions))
    distances, _ = cKDTree(positions).query(positions, k=NEIGHBOURS + 1, workers=usable_cores())
    return np.asarray(distances[:, 1:].mean(axis=1))


@parallel_kernel
def _cover(
    positions: np.ndarray,
    directions: np.ndarray,
    radii: np.ndarray,
    sizes: np.ndarray,
    intrinsics: np.ndarray,
    rotations: np.ndarray,
    translations: np.ndarray,
    centres: np.ndarray,
    least_cosine: float,
    depths: np.ndarray,
) -> None:
    for view in prange(len(sizes)):
        rows, columns = sizes[view]
        fx, fy, cx, cy = intrinsics[view]
        turn, shift = rotations[view], translations[view]
        for point in range(len(positions)):
            x, y, z = positions[point]
            depth = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z + shift[2]
            if depth <= 0:
                continue
            column = fx * (turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z + shift[0]) / depth + cx
            row = fy * (turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z + shift[1]) / depth + cy
            # A cell is covered if its middle lies within the radius, or if it contains the point itself.
            reach = min(radii[point] * fx / depth, LARGEST) + 0.5
            if column < -reach or row < -reach or column > columns + reach or row > rows + reach:
                continue
            dx, dy, dz = centres[view, 0] - x, centres[view, 1] - y, centres[view, 2] - z
            cosine = directions[point, 0] * dx + directions[point, 1] * dy + directions[point, 2] * dz
            known = directions[point, 0] != 0 or directions[point, 1] != 0 or directions[point, 2] != 0
            if known and cosine < least_cosine * np.sqrt(dx * dx + dy * dy + dz * dz):
                continue
            for i in range(max(0, int(np.ceil(row - reach - 0.5))), min(rows, int(np.floor(row + reach - 0.5)) + 1)):
                for j in range(
                    max(0, int(np.ceil(column - reach - 0.5))), min(columns, int(np.floor(column + reach - 0.5)) + 1)
                ):
                    if depth < depths[view, i, j]:
                        depths[view, i, j] = depth


@parallel_kernel
def _count(
    positions: np.ndarray,
    sizes: np.ndarray,
    intrinsics: np.ndarray,
    rotations: np.ndarray,
    translations: np.ndarray,
    usable: np.ndarray,
    bare: np.ndarray,
    shares: np.ndarray,
) -> None:
    """Write for each position the share of bare cells among the usable ones that show it."""
    for point in prange(len(positions)):
        x, y, z = positions[point]
        shown, uncovered = 0, 0
        for view in range(len(sizes)):
            rows, columns = sizes[view]
            fx, fy, cx, cy = intrinsics[view]
            turn, shift = rotations[view], translations[view]
            depth = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z + shift[2]
            if not depth > 0:
                continue
            column = np.floor(fx * (turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z + shift[0]) / depth + cx)
            row = np.floor(fy * (turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z + shift[1]) / depth + cy)
            if column >= 0 and column < columns and row >= 0 and row < rows:
                shown += usable[view, int(row), int(column)]
                uncovered += bare[view, int(row), int(column)]
        if shown:
            shares[point] = uncovered / shown
