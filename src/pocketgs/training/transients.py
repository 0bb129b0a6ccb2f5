"""Transients: parts of photographs that other photographs do not show, such as people who walk by.

Training cannot explain them with one scene, so it puts fog in front of the views that show them. This module finds
their pixels and masks them in the loss. The evidence is the training residual: a place in a photograph is transient
if it differs from the rendering by much more than neighbouring views of the same surface do. Surfaces that are hard
to render, such as fine texture or reflections, have high residuals in all views and are kept.

A photograph with a wrong pose, or of another place, differs nearly everywhere. It is left out whole. Later searches
judge it again, then by a scene that it had no part in, and readmit it if it fits.

SpotLessSplats (Sabour et al. 2024) and WildGaussians (Kulhanek et al. 2024) find transients by residuals too, but
learn a network on image features; here, comparison with views of the same surface replaces it.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.scene.background import Background
from pocketgs.splat.engine import Engine
from pocketgs.training.view_residuals import ComparedView, compare_views, grid_of

FIRST_LOOK, FIRST_EPOCHS = 150, 2
"""Minimum iterations before the first search, and minimum steps per view by then."""

CERTAIN, LIKELY = 4.0, 2.0
"""A region is transient if its residuals are LIKELY times the expected ones, and in a part of it CERTAIN times."""

MIN_RESIDUAL = 0.04
"""Residual, in display values, below which no cell is transient; half a step of exposure in the dark is less."""

MIN_REGION = 0.002
"""Minimum area of a region without its rim, relative to the photograph; also of the certain cells in it."""

MAX_SHARE = 0.5
"""Transients cover at most this share of a photograph; what covers more is not masked."""

MIN_COMPARABLE = 0.2
"""Minimum share of a view's unmasked cells that neighbours see too, to decide whether they contradict the view."""

MAX_LEFT_OUT = 0.25
"""Views are left out only up to this share of all: of more, it is unclear which are wrong."""


class Transients:
    """Masks transients in the loss, as they are found during a run.

    Args:
        frames: the training views.
        background: of the renderings.
        cells: transients found earlier in the run, or None.
    """

    def __init__(self, frames: Sequence[Frame], background: Background, cells: Sequence[np.ndarray] | None) -> None:
        self._frames, self._background = frames, background
        self._first = max(FIRST_LOOK, FIRST_EPOCHS * len(frames))
        self._remember(cells)

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
        cells = [np.zeros(grid_of(frame), np.bool_) for frame in self._frames]
        for view, of_view in zip(trained, found, strict=True):
            cells[view] = of_view
        if _any(cells) or self.cells is not None:
            engine.set_masks(self._masks(cells))
        self._remember(cells)

    def used(self, views: Sequence[int]) -> Sequence[int]:
        """Those of the views that are not left out whole."""
        if not self._left_out:
            return views
        return [view for view in views if view not in self._left_out] or views

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of the training views that are left out whole, since the others contradict them."""
        return tuple(self._frames[view].name for view in self._left_out)

    def _remember(self, cells: Sequence[np.ndarray] | None) -> None:
        self.cells = None if cells is None else tuple(cells)
        self._left_out = [view for view, of_view in enumerate(self.cells or ()) if is_left_out(of_view)]

    def _masks(self, cells: Sequence[np.ndarray]) -> list[np.ndarray | None]:
        return [mask_without(frame, of_view) for frame, of_view in zip(self._frames, cells, strict=True)]


def _any(cells: Sequence[np.ndarray]) -> bool:
    return any(of_view.any() for of_view in cells)


def transient_cells(engine: Engine, frames: Sequence[Frame], background: Background) -> list[np.ndarray]:
    """Find the cells of each training view that show transients, given the current scene.

    All cells of a view that its neighbours contradict are returned, unless too many views would be left out.

    Args:
        engine: with the scene.
        frames: the training views.
        background: of the renderings.

    Returns:
        (h, w) bool for each view, h and w at most CELLS.
    """
    views = compare_views(engine, frames, background)
    doubted = [_is_contradicted(view) for view in views]
    leave_out = sum(doubted) <= MAX_LEFT_OUT * len(views)
    return [
        np.full(view.residuals.shape, leave_out) if doubt else _regions(view)
        for view, doubt in zip(views, doubted, strict=True)
    ]


def is_left_out(cells: np.ndarray) -> bool:
    """Whether (h, w) cells leave out a whole view, since the others contradict it."""
    return bool(cells.all())


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


def _is_contradicted(view: ComparedView) -> bool:
    """Whether most of what neighbouring views see too certainly differs: the pose is wrong, or the place is another."""
    used = view.residuals > 0
    comparable = used & np.isfinite(view.expected)
    if not used.any() or comparable.sum() < MIN_COMPARABLE * used.sum():
        return False
    residuals, expected = view.residuals[comparable], view.expected[comparable]
    return bool(np.median(residuals / expected) > CERTAIN and residuals.mean() > MIN_RESIDUAL)


def _regions(view: ComparedView) -> np.ndarray:
    """(h, w) connected regions of likely cells that contain certain ones, with their rims.

    Strips along edges are not regions: they come from poses that are slightly off.
    """
    residuals, expected = view.residuals, view.expected
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
