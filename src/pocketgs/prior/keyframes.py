"""Keyframe selection: frames whose depth maps together cover the training views several times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.capture.even_choice import evenly_chosen
from pocketgs.capture.sharpness import sharpness
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.prior.depth.source_views import LEAST_PARALLAX

CELLS = 12
"""Number of cells along the longer side of a view; coverage is counted in cells."""

NEIGHBOURING_FRAMES = 4
"""A frame's sharpness is compared with that of this many frames before and after it. They show much the same, so that
the comparison tells of blur and not of texture.
"""

HIDDEN = 1.5
"""If a keyframe's own depth is smaller by this factor, the point is occluded."""

COARSER = 2.0
"""Maximum ratio of the keyframe's pixel footprint to the view's: above it, the keyframe lacks detail."""

WIDEST_VIEWING_ANGLE = np.radians(60)
"""Maximum angle between viewing directions for matching."""

COPIED = 0.8
"""One of two views at the same place is a copy if the other sees more than this share of its cells."""

MAX_VIEWS = 300
"""Maximum number of frames to consider, evenly spaced: it bounds memory and time."""


@dataclass(frozen=True)
class KeyframeSettings:
    """Settings of keyframe selection.

    Attributes:
        max_keyframes: hard limit.
        views: number of keyframes that should see every part of a training view: depths gain confidence with every
            other depth map that confirms them, and have little without any.
        least_gain: minimum share of all cells that another keyframe must cover.

    Raises:
        PocketGSError: the limit is less than two keyframes.
    """

    max_keyframes: int = 100
    views: int = 4
    least_gain: float = 5e-4

    def __post_init__(self) -> None:
        if self.max_keyframes < 2:
            raise PocketGSError(f"max keyframes: found {self.max_keyframes}, expected at least 2")


@dataclass(frozen=True)
class Decision:
    """Whether a frame is a keyframe, and why.

    Attributes:
        name: of the frame.
        kept: whether it is a keyframe.
        reason: as text.
        sharpness: mean absolute difference of neighbouring grey levels, see `pocketgs.capture.sharpness`.
    """

    name: str
    kept: bool
    reason: str
    sharpness: float


def select_keyframes(
    frames: Sequence[Frame], points: Sequence[np.ndarray], distance: float, settings: KeyframeSettings
) -> list[Decision]:
    """Select keyframes greedily: the next one is the frame that sees most of what too few keyframes see so far.

    Every view is divided into cells; sparse points give the rough distance of each cell. A keyframe sees a cell if the
    cell's middle projects into its image, is not occluded, and is not seen from too far away or from too different a
    direction. Frames that are blurrier than their neighbours count less. Copies of a keyframe are left out: they tell
    no depth together with it.

    Args:
        frames: the training frames, in capture order.
        points: for each frame, (M, 3) the sparse points that it sees.
        distance: typical distance to the scene, for frames without points.
        settings: thresholds.

    Returns:
        One decision per frame. At least one frame is selected if there is any.
    """
    sharpnesses = np.array([sharpness(cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY)) for frame in frames])
    looked_at = evenly_chosen(len(frames), MAX_VIEWS)
    views = [_Cells.of(frames[index], points[index], distance) for index in looked_at]
    relative = _relative_sharpness(sharpnesses)[looked_at] ** 2
    chosen = {int(looked_at[view]): gain for view, gain in _greedy(views, relative, settings)}
    considered = set(looked_at.tolist())
    is_full = len(chosen) == settings.max_keyframes
    others = f"others cover more, of at most {len(chosen)}" if is_full else "what it sees is covered"
    decisions = []
    for index, frame in enumerate(frames):
        if index in chosen:
            reason = f"covers {chosen[index]:.1%} more"
        else:
            reason = others if index in considered else f"not among the {len(looked_at)} considered"
        decisions.append(Decision(frame.name, index in chosen, reason, float(sharpnesses[index])))
    return decisions


def _relative_sharpness(sharpnesses: np.ndarray) -> np.ndarray:
    """(F,) at most 1: each frame's sharpness over the median of its neighbours', without itself."""
    if len(sharpnesses) < 2:
        return np.ones(len(sharpnesses))
    around = []
    for index in range(len(sharpnesses)):
        before = sharpnesses[max(0, index - NEIGHBOURING_FRAMES) : index]
        around.append(np.median([*before, *sharpnesses[index + 1 : index + 1 + NEIGHBOURING_FRAMES]]))
    return np.minimum(sharpnesses / np.maximum(around, 1e-9), 1.0)


@dataclass(frozen=True)
class _Cells:
    """The cells of one view.

    Attributes:
        camera: of the view.
        depths: (rows, columns) of all cells.
        positions: (C, 3) world positions of the middles of unmasked cells.
        lengths: (C,) footprint of a pixel there.
    """

    camera: Camera
    depths: np.ndarray
    positions: np.ndarray
    lengths: np.ndarray

    @staticmethod
    def of(frame: Frame, points: np.ndarray, distance: float) -> _Cells:
        camera = frame.camera
        rows, columns = camera.grid_shape(CELLS)
        depths = _cell_depths(camera, points, rows, columns, distance)
        row, column = (index.ravel() for index in np.indices((rows, columns)))
        pixels = np.stack([(column + 0.5) * camera.width / columns, (row + 0.5) * camera.height / rows], axis=1)
        if frame.usable is not None:
            x, y = pixels.astype(np.int64).T
            used = frame.usable[y, x]
            row, column, pixels = row[used], column[used], pixels[used]
        depth = depths[row, column]
        return _Cells(camera, depths, camera.centre + camera.rays(pixels) * depth[:, None], depth / camera.fx)


def _cell_depths(camera: Camera, points: np.ndarray, rows: int, columns: int, distance: float) -> np.ndarray:
    """(rows, columns) the depth of the sparse point nearest to each cell in the image."""
    pixels, depth = camera.project(points)
    seen = depth > 0
    if not seen.any():
        return np.full((rows, columns), distance)
    middles = np.stack(np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5), axis=2).reshape(-1, 1, 2)
    places = pixels[seen] * (columns / camera.width, rows / camera.height)
    nearest = np.argmin(np.sum((middles - places) ** 2, axis=2), axis=1)
    return depth[seen][nearest].reshape(rows, columns)


def _greedy(views: Sequence[_Cells], weights: np.ndarray, settings: KeyframeSettings) -> list[tuple[int, float]]:
    """The selected views in order, each with the share of all cells that it newly covers."""
    if not views:
        return []
    positions, lengths = (np.concatenate([getattr(view, name) for view in views]) for name in ("positions", "lengths"))
    origins = np.repeat([view.camera.centre for view in views], [len(view.positions) for view in views], axis=0)
    rays = positions - origins
    seen = np.stack([_sees(view, positions, lengths, rays) for view in views]).astype(np.float32)
    wanted = np.full(len(positions), settings.views)
    left = np.ones(len(views), bool)
    selected: list[tuple[int, float]] = []
    while left.any() and len(selected) < settings.max_keyframes:
        gains = seen @ (wanted > 0).astype(np.float32) / max(len(positions), 1)
        best = int(np.argmax(np.where(left, gains * weights, -1.0)))
        if len(selected) >= settings.views and gains[best] < settings.least_gain:
            break
        selected.append((best, float(gains[best])))
        wanted -= seen[best] > 0
        left[best] = False
        left &= ~_copies(views[best], views, seen[best])
    return selected


def _copies(view: _Cells, views: Sequence[_Cells], seen: np.ndarray) -> np.ndarray:
    """(V,) bool: which views are in the same place as a view that sees most of what they see.

    Args:
        view: any view.
        views: V views.
        seen: (C,) whether it sees the cells of all of them.
    """
    counts = [len(other.positions) for other in views]
    shared = np.bincount(np.repeat(np.arange(len(views)), counts), seen, len(views))
    baselines = np.linalg.norm([other.camera.centre - view.camera.centre for other in views], axis=1)
    near = baselines < LEAST_PARALLAX * np.median(view.depths)
    return near & (shared > COPIED * np.array(counts))


def _sees(view: _Cells, positions: np.ndarray, lengths: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """(C,) bool: whether a view sees positions that others see along rays."""
    camera = view.camera
    pixels, depth = camera.project(positions)
    inside = camera.shows(pixels, depth)
    rows, columns = view.depths.shape
    column, row = (np.where(inside[:, None], pixels, 0) * (columns / camera.width, rows / camera.height)).astype(int).T
    unhidden = depth < HIDDEN * view.depths[row, column]
    fine_enough = depth / camera.fx < COARSER * lengths
    own_rays = positions - camera.centre
    cosines = np.sum(own_rays * rays, axis=1)
    norms = np.linalg.norm(own_rays, axis=1) * np.linalg.norm(rays, axis=1)
    return inside & unhidden & fine_enough & (cosines > np.cos(WIDEST_VIEWING_ANGLE) * norms)
