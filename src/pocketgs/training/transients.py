"""Transients: parts of photographs that other photographs do not show, such as people who walk by.

Training cannot explain them with one scene, so it puts fog in front of the views that show them. This module finds
their pixels and masks them in the loss. The evidence is the training residual: a place in a photograph is transient
if it differs from the rendering by much more than neighbouring views of the same surface do. Surfaces that are hard
to render, such as fine texture or reflections, have high residuals in all views and are kept.

SpotLessSplats (Sabour et al. 2024) and WildGaussians (Kulhanek et al. 2024) find transients by residuals too, but
learn a network on image features; here, comparison with views of the same surface replaces it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.splat.engine import Engine

FIRST_LOOK, FIRST_EPOCHS = 150, 2
"""Minimum iterations before the first search, and minimum steps per view by then."""

CELLS = 80
"""Number of cells along a photograph's longer side. Residuals are means over cells, which averages out texture."""

PIXELS_PER_CELL = 4
"""Side of a cell in the compared renderings, in pixels."""

NEIGHBOURS, MIN_NEIGHBOURS = 8, 3
"""Number of neighbouring views to compare with, and how many of them must see a surface."""

SAME_DEPTH = 0.1
"""Relative difference up to which two views see the same surface."""

CERTAIN, LIKELY = 4.0, 2.0
"""A region is transient if its residuals are LIKELY times the expected ones, and in a part of it CERTAIN times."""

MIN_RESIDUAL = 0.04
"""Residual, in display values, below which no cell is transient; half a step of exposure in the dark is less."""

WINDOW, MAX_GAIN = 5, 2.0
"""Side in cells of the surroundings for comparing brightness, and the maximum ratio of brightness."""

MIN_REGION = 0.002
"""Minimum area of a region without its rim, relative to the photograph; also of the certain cells in it."""

MAX_SHARE = 0.5
"""A photograph that differs in more than this share is not masked: its pose or exposure is wrong."""


class Transients:
    """Masks transients in the loss, as they are found during a run.

    Args:
        frames: the training views.
        background: of the renderings.
        cells: transients found earlier in the run, or None.
    """

    def __init__(
        self, frames: Sequence[Frame], background: tuple[float, float, float], cells: Sequence[np.ndarray] | None
    ) -> None:
        self._frames, self._background = frames, background
        self._first = max(FIRST_LOOK, FIRST_EPOCHS * len(frames))
        self.cells = None if cells is None else tuple(cells)

    def start(self, engine: Engine) -> None:
        """Apply the known masks, once the engine has the photographs."""
        if self.cells is not None and _any(self.cells):
            engine.set_masks(self._masks(self.cells))

    def after_step(self, iteration: int, engine: Engine, trained: Sequence[int]) -> None:
        """Search for transients after the first iterations and, while there are any, whenever their number has doubled.

        Args:
            iteration: number of steps taken.
            engine: with the scene.
            trained: indices of the trained views. The others are not judged: the scene differs from them anyway, since
                it was not trained on them.
        """
        doublings, rest = divmod(iteration, self._first)
        is_due = rest == 0 and doublings & (doublings - 1) == 0
        if not is_due or (self.cells is not None and not _any(self.cells)):
            return
        found = transient_cells(engine, [self._frames[view] for view in trained], self._background)
        cells = [np.zeros(_grid(frame), np.bool_) for frame in self._frames]
        for view, of_view in zip(trained, found, strict=True):
            cells[view] = of_view
        if _any(cells) or self.cells is not None:
            engine.set_masks(self._masks(cells))
        self.cells = tuple(cells)

    def _masks(self, cells: Sequence[np.ndarray]) -> list[np.ndarray | None]:
        return [mask_without(frame, of_view) for frame, of_view in zip(self._frames, cells, strict=True)]


def _any(cells: Sequence[np.ndarray]) -> bool:
    return any(of_view.any() for of_view in cells)


@dataclass(frozen=True)
class _Compared:
    """A training view and its rendering, by cell.

    Attributes:
        frame: the view.
        residuals: (h, w) mean absolute difference of the colours.
        depths: (h, w) rendered depth, 0 where there is none.
        points: (h, w, 3) of the rendered surface.
    """

    frame: Frame
    residuals: np.ndarray
    depths: np.ndarray
    points: np.ndarray


def transient_cells(
    engine: Engine, frames: Sequence[Frame], background: tuple[float, float, float]
) -> list[np.ndarray]:
    """Find the cells of each training view that show transients, given the current scene.

    Args:
        engine: with the scene.
        frames: the training views.
        background: of the renderings.

    Returns:
        (h, w) bool for each view, h and w at most CELLS.
    """
    views = [_compared(engine, frame, background) for frame in frames]
    centres = np.array([frame.camera.centre for frame in frames])
    forwards = np.array([frame.camera.forward for frame in frames])
    drawn = np.concatenate([view.residuals[view.depths > 0] for view in views])
    usual = float(np.median(drawn)) if len(drawn) else np.inf
    found = []
    for index, view in enumerate(views):
        neighbours = [views[other] for other in _neighbours(index, centres, forwards)]
        expected = np.maximum(_expected(view, neighbours), usual)
        found.append(_regions(view.residuals, expected))
    return found


def mask_without(frame: Frame, cells: np.ndarray) -> np.ndarray | None:
    """The (H, W) bool mask of a frame without its (h, w) transient cells; None if no pixel is masked."""
    if not cells.any():
        return frame.mask
    kept = ~pixels_of(cells, frame)
    return kept if frame.mask is None else kept & frame.mask


def pixels_of(cells: np.ndarray, frame: Frame) -> np.ndarray:
    """(H, W) bool: the pixels of a frame in the (h, w) cells."""
    height, width = frame.image.shape[:2]
    rows, columns = np.arange(height) * cells.shape[0] // height, np.arange(width) * cells.shape[1] // width
    return np.asarray(cells[rows[:, None], columns])


def _grid(frame: Frame) -> tuple[int, int]:
    """Number of rows and columns of cells of a photograph."""
    height, width = frame.image.shape[:2]
    scale = min(1.0, CELLS * PIXELS_PER_CELL / max(height, width)) / PIXELS_PER_CELL
    return max(1, round(height * scale)), max(1, round(width * scale))


def _compared(engine: Engine, frame: Frame, background: tuple[float, float, float]) -> _Compared:
    down, across = _grid(frame)
    size = (across * PIXELS_PER_CELL, down * PIXELS_PER_CELL)
    rendered = engine.render(frame.camera.resized(*size), background, depth=True)
    assert rendered.depth is not None
    photo = cv2.resize(frame.image, size, interpolation=cv2.INTER_AREA).astype(np.float32) / 255.0
    shown, seen = _means(np.clip(rendered.image, 0.0, 1.0)), _means(photo)
    counts = np.ones((down, across), np.bool_)
    if frame.mask is not None:
        counts = cv2.resize(frame.mask.astype(np.float32), (across, down), interpolation=cv2.INTER_AREA) > 0.5
    depths = np.where(_means(rendered.alpha) > 0.5, np.median(_blocks(rendered.depth), axis=(1, 3)), 0.0)
    residuals = np.where(counts, _differences(seen, shown), 0.0)
    cell_camera = frame.camera.resized(across, down)
    x, y = np.meshgrid(np.arange(across) + 0.5, np.arange(down) + 0.5)
    rays = cell_camera.rays(np.stack([x.ravel(), y.ravel()], axis=1))
    points = cell_camera.centre + rays * depths.reshape(-1, 1)
    return _Compared(frame, residuals, depths, points.reshape(down, across, 3))


def _blocks(image: np.ndarray) -> np.ndarray:
    height, width = image.shape[:2]
    sides = (height // PIXELS_PER_CELL, PIXELS_PER_CELL, width // PIXELS_PER_CELL, PIXELS_PER_CELL)
    return image.reshape(*sides, *image.shape[2:])


def _means(image: np.ndarray) -> np.ndarray:
    return np.asarray(_blocks(image).mean(axis=(1, 3)))


def _differences(seen: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """(h, w) mean absolute difference of colours, after matching brightness.

    Shadows, such as the photographer's, and changes of exposure are not transients: they only scale the brightness.
    So the rendering is multiplied by the factor that best matches the photograph around the cell, or on one side of
    it, since shadows have edges.
    """
    products = cv2.blur((seen * shown).sum(axis=2), (WINDOW, WINDOW))
    squares = cv2.blur((shown * shown).sum(axis=2), (WINDOW, WINDOW))
    gains = np.clip(products / np.maximum(squares, 1e-6), 1.0 / MAX_GAIN, MAX_GAIN)
    reach = WINDOW // 2
    around = np.pad(gains, reach, mode="edge")
    height, width = gains.shape
    sides = ((reach, reach), (0, reach), (2 * reach, reach), (reach, 0), (reach, 2 * reach))
    lights = [around[top : top + height, left : left + width, None] for top, left in sides]
    return np.asarray(np.min([np.abs(shown * light - seen).mean(axis=2) for light in lights], axis=0))


def _neighbours(index: int, centres: np.ndarray, forwards: np.ndarray) -> np.ndarray:
    """Indices of the nearest cameras among those with a similar viewing direction."""
    alike = forwards @ forwards[index] > 0.5
    alike[index] = False
    candidates = np.flatnonzero(alike)
    distances = np.linalg.norm(centres[candidates] - centres[index], axis=1)
    return candidates[np.argsort(distances, kind="stable")[:NEIGHBOURS]]


def _expected(view: _Compared, neighbours: Sequence[_Compared]) -> np.ndarray:
    """(h, w) median residual of the same surface in neighbouring views; infinite if too few of them see it."""
    shape = view.residuals.shape
    points = view.points.reshape(-1, 3)
    found = np.full((len(neighbours), len(points)), np.nan)
    for row, other in enumerate(neighbours):
        height, width = other.residuals.shape
        pixels, depths = other.frame.camera.resized(width, height).project(points)
        cells = np.floor(pixels).astype(np.int64)
        inside = (cells >= 0).all(axis=1) & (cells < (width, height)).all(axis=1) & (depths > 0)
        inside &= view.depths.ravel() > 0
        places = np.where(inside[:, None], cells, 0)
        there = other.depths[places[:, 1], places[:, 0]]
        seen = inside & (np.abs(there - depths) <= SAME_DEPTH * depths)
        found[row] = np.where(seen, other.residuals[places[:, 1], places[:, 0]], np.nan)
    enough = (~np.isnan(found)).sum(axis=0) >= MIN_NEIGHBOURS
    expected = np.full(len(points), np.inf)
    expected[enough] = np.nanmedian(found[:, enough], axis=0)
    return expected.reshape(shape)


def _regions(residuals: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """(h, w) connected regions of likely cells that contain certain ones, with their rims.

    Strips along edges are not regions: they come from poses that are slightly off.
    """
    likely = (residuals > np.maximum(LIKELY * expected, MIN_RESIDUAL)).astype(np.uint8)
    certain = residuals > np.maximum(CERTAIN * expected, 2.0 * MIN_RESIDUAL)
    inner = cv2.erode(likely, np.ones((3, 3), np.uint8)).astype(np.bool_)
    count, labels = cv2.connectedComponents(likely, connectivity=8)
    least = max(MIN_REGION * likely.size, 4.0)
    kept = [
        label
        for label in range(1, count)
        if (inner & (labels == label)).sum() >= least and (certain & (labels == label)).sum() >= least
    ]
    cells = cv2.dilate(np.isin(labels, kept).astype(np.uint8), np.ones((3, 3), np.uint8)).astype(np.bool_)
    return cells if cells.mean() <= MAX_SHARE else np.zeros_like(cells)
