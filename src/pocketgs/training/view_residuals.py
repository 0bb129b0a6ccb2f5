"""Residuals of training views, by cell, and those that neighbouring views of the same surface let expect.

What is hard to render, such as fine texture or reflections, has high residuals in all views. So evidence against a view
is a residual that is higher than in its neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.scene.background import Background
from pocketgs.splat.engine import Engine

CELLS = 80
"""Number of cells along a photograph's longer side. Residuals are means over cells, which averages out texture."""

PIXELS_PER_CELL = 4
"""Side of a cell in the compared renderings, in pixels."""

NEIGHBOURS, MIN_NEIGHBOURS = 8, 3
"""Number of neighbouring views to compare with, and how many of them must see a surface."""

SAME_DEPTH = 0.1
"""Relative difference up to which two views see the same surface."""

WINDOW, MAX_GAIN = 5, 2.0
"""Side in cells of the surroundings for comparing brightness, and the maximum ratio of brightness."""


@dataclass(frozen=True)
class ComparedView:
    """How a training view differs from its rendering, by cell, and how much its neighbours do.

    Attributes:
        residuals: (h, w) mean absolute difference of the colours; 0 in masked cells.
        expected: (h, w) median residual of the same surface in neighbouring views, at least that of all views' cells;
            infinite where too few neighbours see it.
    """

    residuals: np.ndarray
    expected: np.ndarray


def compare_views(engine: Engine, frames: Sequence[Frame], background: Background) -> list[ComparedView]:
    """Compare training views with their renderings and with their neighbours, given the current scene.

    Args:
        engine: with the scene.
        frames: the training views.
        background: of the renderings.
    """
    views = [_rendered(engine, frame, background) for frame in frames]
    centres = np.array([frame.camera.centre for frame in frames])
    forwards = np.array([frame.camera.forward for frame in frames])
    drawn = np.concatenate([view.residuals[view.depths > 0] for view in views])
    usual = float(np.median(drawn)) if len(drawn) else np.inf
    found = []
    for index, view in enumerate(views):
        neighbours = [views[other] for other in _neighbours(index, centres, forwards)]
        found.append(ComparedView(view.residuals, np.maximum(_expected(view, neighbours), usual)))
    return found


@dataclass(frozen=True)
class _Rendered:
    """A training view and its rendering, by cell.

    Attributes:
        frame: the view.
        residuals: (h, w) mean absolute difference of the colours.
        depths: (h, w) rendered depth; 0 where there is none, and in masked cells.
        points: (h, w, 3) of the rendered surface.
    """

    frame: Frame
    residuals: np.ndarray
    depths: np.ndarray
    points: np.ndarray


def grid_of(frame: Frame) -> tuple[int, int]:
    """Number of rows and columns of cells of a photograph."""
    height, width = frame.image.shape[:2]
    scale = min(1.0, CELLS * PIXELS_PER_CELL / max(height, width)) / PIXELS_PER_CELL
    return max(1, round(height * scale)), max(1, round(width * scale))


def _rendered(engine: Engine, frame: Frame, background: Background) -> _Rendered:
    down, across = grid_of(frame)
    size = (across * PIXELS_PER_CELL, down * PIXELS_PER_CELL)
    rendered = engine.render(frame.camera.resized(*size), background, depth=True)
    assert rendered.depth is not None
    photo = cv2.resize(frame.image, size, interpolation=cv2.INTER_AREA).astype(np.float32) / 255.0
    shown, seen = _means(np.clip(rendered.image, 0.0, 1.0)), _means(photo)
    counts = np.ones((down, across), np.bool_)
    if frame.mask is not None:
        counts = cv2.resize(frame.mask.astype(np.float32), (across, down), interpolation=cv2.INTER_AREA) > 0.5
    depths = np.where(counts & (_means(rendered.alpha) > 0.5), np.median(_blocks(rendered.depth), axis=(1, 3)), 0.0)
    residuals = np.where(counts, _differences(seen, shown), 0.0)
    cell_camera = frame.camera.resized(across, down)
    x, y = np.meshgrid(np.arange(across) + 0.5, np.arange(down) + 0.5)
    rays = cell_camera.rays(np.stack([x.ravel(), y.ravel()], axis=1))
    points = cell_camera.centre + rays * depths.reshape(-1, 1)
    return _Rendered(frame, residuals, depths, points.reshape(down, across, 3))


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


def _expected(view: _Rendered, neighbours: Sequence[_Rendered]) -> np.ndarray:
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
