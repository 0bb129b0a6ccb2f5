"""Stereo on the CPU."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import cv2
import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.geometry.camera import Camera
from pocketgs.prior.depth.confidence import confidence_map
from pocketgs.prior.depth.consistency import Agreement, ConfidenceMap, SweptViews
from pocketgs.prior.depth.cpu.consistency import compare_depths
from pocketgs.prior.depth.cpu.matching_cost import ALL_USABLE, SourceViews, matching_costs, squares_of
from pocketgs.prior.depth.cpu.semi_global import EIGHT_PATHS, FOUR_PATHS, aggregate, winners
from pocketgs.prior.depth.depth_range import MOST, DepthRange
from pocketgs.prior.depth.source_views import mapping
from pocketgs.prior.depth.stereo import MAP_BYTES, StereoExtent, StereoNeed
from pocketgs.prior.depth.sweep import DepthMap, SweepSettings, no_depth, step_of
from pocketgs.prior.depth.sweep_constants import BITS, SMOOTHING_STEPS, SMOOTHING_WIDTH, SMOOTHING_WINDOW
from pocketgs.system.device import DeviceName, MemoryNeed

HYPOTHESIS_BYTES, PIXEL_BYTES, SOURCE_BYTES = 3, 40, 4
"""Bytes per pixel and hypothesis: a cost of one byte, and a sum of two. Bytes per pixel of its copies, and of a
source view padded to the size of the others."""


class CpuStereo:
    """See `pocketgs.prior.depth.stereo.Stereo`."""

    name: DeviceName = "cpu"

    def memory_needed(self, extent: StereoExtent) -> StereoNeed:
        """Of this process alone; comparisons take the padded depth maps."""
        sweeping = extent.pixels * (HYPOTHESIS_BYTES * MOST + PIXEL_BYTES)
        sources = SOURCE_BYTES * extent.source_views * extent.padded_pixels
        comparing = MAP_BYTES * extent.keyframes * extent.padded_pixels
        return StereoNeed(MemoryNeed(sweeping + sources), MemoryNeed(comparing))

    def reserve(self, extent: StereoExtent) -> None:
        """Nothing to do: each sweep takes what it needs."""

    def release(self) -> None:
        """Nothing to do."""

    def sweep(
        self, keyframe: Frame, source_views: Sequence[Frame], search: DepthRange, settings: SweepSettings
    ) -> DepthMap:
        """Compute the depth map of a keyframe."""
        if not source_views:
            return no_depth(keyframe, search)
        view, inverse_depths = grey_levels(keyframe), search.inverse_depths
        costs = matching_costs(view, as_source_views(keyframe.camera, source_views), inverse_depths)
        if keyframe.mask is not None:
            costs[~keyframe.mask] = BITS // 2  # as for hypotheses that no source view sees
        paths = EIGHT_PATHS if settings.paths == 8 else FOUR_PATHS
        total = aggregate(costs, view, paths, settings.small_step, settings.large_step)
        depth, margin = winners(total, inverse_depths, len(paths))
        if np.isfinite(search.farthest):  # the true depth may be outside the range
            depth[depth * inverse_depths[0] > 1 - 1e-6] = 0
        if keyframe.usable is not None:
            depth[~keyframe.usable] = 0
        step = step_of(inverse_depths)
        return DepthMap(smoothed(depth, step), margin, step)

    def compare(
        self, views: SweptViews, margins: Sequence[np.ndarray], tolerance: float, least: float
    ) -> Iterator[ConfidenceMap]:
        """Compare the depths of each view with the other views' depths."""
        for view, (height, width) in enumerate(views.sizes):
            agreement = Agreement(*compare_depths(views, view, tolerance))
            depth = views.depths[view, :height, :width]
            yield ConfidenceMap(confidence_map(agreement, depth, margins[view], least), agreement.footprints)


def smoothed(depth: np.ndarray, spacing: float) -> np.ndarray:
    """Remove the steps between hypotheses on slanted surfaces.

    A bilateral filter on inverse depth, which is linear in pixels on a plane of any slant: the mean over a symmetric
    window is unbiased there, and edges of more than a few hypotheses are kept.

    Args:
        depth: (H, W) float32, 0 where unknown.
        spacing: difference in inverse depth of neighbouring hypotheses.
    """
    known = depth > 0
    # Unknown depths are set so far from all others that they do not take part in any mean.
    elsewhere = np.full_like(depth, -10 * SMOOTHING_STEPS * spacing)
    inverse = np.divide(1.0, depth, out=elsewhere, where=known)
    # OpenCV's filter does nothing where values are tiny, as inverse depths in millimetres are. Division by a power of
    # two near the spacing loses no precision.
    unit = math.ldexp(1.0, math.frexp(spacing)[1])
    smooth = cv2.bilateralFilter(inverse / unit, SMOOTHING_WINDOW, SMOOTHING_STEPS * spacing / unit, SMOOTHING_WIDTH)
    return np.divide(1.0, smooth * unit, out=np.zeros_like(depth), where=known)


def grey_levels(frame: Frame) -> np.ndarray:
    """(H, W) uint8 greyscale image, black where it is masked, so that masked pixels have no influence."""
    grey = cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY)
    if frame.mask is not None:
        grey[~frame.mask] = 0
    return grey


def as_source_views(view: Camera, frames: Sequence[Frame]) -> SourceViews:
    """The source views' images, and the mapping of a view's pixels into them."""
    images = [grey_levels(frame) for frame in frames]
    sizes = np.array([image.shape for image in images])
    squares = np.zeros((len(images), *sizes.max(axis=0)), np.uint32)
    turns, shifts = np.empty((len(images), 3, 3), np.float32), np.empty((len(images), 3), np.float32)
    for index, (image, frame) in enumerate(zip(images, frames, strict=True)):
        squares[index, : image.shape[0], : image.shape[1]] = squares_of(image)
        turns[index], shifts[index] = mapping(view, frame.camera)
    return SourceViews(squares, sizes.astype(np.float32), turns, shifts, _usable_of(frames, squares.shape))


def _usable_of(frames: Sequence[Frame], shape: tuple[int, ...]) -> np.ndarray:
    """Unmasked pixels of the source views, padded to one size."""
    if all(frame.mask is None for frame in frames):
        return ALL_USABLE
    usable = np.ones(shape, np.bool_)
    for padded, frame in zip(usable, frames, strict=True):
        if frame.mask is not None:
            padded[: frame.mask.shape[0], : frame.mask.shape[1]] = frame.mask
    return usable
