"""Fusion of the keyframes' depth maps to a point cloud of the pixels that are consistent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.prior.cloud.detail import detail
from pocketgs.prior.cloud.merge import Candidates
from pocketgs.prior.cloud.visual_hull import outside_hull
from pocketgs.prior.depth.consistency import ConfidenceMap, SweptViews
from pocketgs.prior.depth.stereo import Stereo
from pocketgs.prior.depth.sweep import DepthMap

SHELL_EXTENT = 4.0
"""Minimum radius of the sphere for distant points, as a multiple of the extent of the cameras."""

MAX_CANDIDATES = 2_000_000
"""Maximum number of pixels to merge, over all keyframes: it bounds memory."""


@dataclass(frozen=True)
class FusionSettings:
    """Thresholds of fusion.

    Attributes:
        confidence: minimum confidence of a pixel.
        tolerance: maximum relative difference of two views' depths that agree.
    """

    confidence: float = 0.4
    tolerance: float = 0.005


def fuse(
    keyframes: Sequence[Frame],
    maps: Sequence[DepthMap],
    frames: Sequence[Frame],
    settings: FusionSettings,
    stereo: Stereo,
) -> Candidates:
    """Fuse pixels that other keyframes confirm, and in the holes between them those that none contradicts.

    Args:
        keyframes: K frames.
        maps: their depth maps.
        frames: training frames, whose alpha bounds the cloud.
        settings: thresholds.
        stereo: compares the depth maps.
    """
    views = views_of(keyframes, maps)
    shell = _far_shell(keyframes, maps)
    known = sum(np.count_nonzero(map_.depth) for map_ in maps)
    stride = max(1, -(-known // most_candidates(sum(map_.depth.size for map_ in maps))))
    compared = stereo.compare(views, [map_.margin for map_ in maps], settings.tolerance, settings.confidence)
    found = [
        _candidates(keyframe, map_, confirmed, stride, shell)
        for keyframe, map_, confirmed in zip(keyframes, maps, compared, strict=True)
    ]
    names = Candidates.__dataclass_fields__
    together = Candidates(**{name: np.concatenate([getattr(some, name) for some in found]) for name in names})
    return together.select(~outside_hull(together.positions, frames))


def most_candidates(pixels: int) -> int:
    """Maximum number of pixels to merge: of every so many one, if all of them had depth."""
    return -(-pixels // max(1, -(-pixels // MAX_CANDIDATES)))


def views_of(keyframes: Sequence[Frame], maps: Sequence[DepthMap]) -> SweptViews:
    """The depth maps of keyframes, to compare."""
    sizes = np.array([map_.depth.shape for map_ in maps], np.int64)
    depths = np.zeros((len(maps), *sizes.max(axis=0)), np.float32)
    for padded, map_ in zip(depths, maps, strict=True):
        padded[: map_.depth.shape[0], : map_.depth.shape[1]] = map_.depth
    cameras = [keyframe.camera for keyframe in keyframes]
    return SweptViews(
        depths,
        np.array([(camera.fx, camera.fy, camera.cx, camera.cy) for camera in cameras]),
        sizes,
        np.array([camera.world_to_camera[:3, :3] for camera in cameras]),
        np.array([camera.world_to_camera[:3, 3] for camera in cameras]),
        np.array([map_.step for map_ in maps]),
    )


def _candidates(
    keyframe: Frame, map_: DepthMap, confirmed: ConfidenceMap, stride: int, shell: tuple[np.ndarray, float]
) -> Candidates:
    """The pixels of a keyframe with confidence."""
    confidences, footprints = confirmed
    rows, columns = (places[::stride] for places in np.nonzero(confidences))
    camera = keyframe.camera
    rays = camera.rays(np.column_stack([columns, rows]) + 0.5)
    depths, lengths = map_.depth[rows, columns].astype(np.float64), footprints[rows, columns]
    unresolved = depths > map_.resolved
    depths[unresolved] = _depths_on_shell(camera.centre, rays[unresolved], *shell)
    lengths[unresolved] = depths[unresolved] / camera.fx
    return Candidates(
        positions=camera.centre + rays * depths[:, None],
        colours=keyframe.image[rows, columns] / np.float32(255),
        directions=-rays / np.linalg.norm(rays, axis=1, keepdims=True),
        footprints=lengths,
        details=detail(keyframe.image)[rows, columns],
        confidences=confidences[rows, columns],
    )


def _far_shell(keyframes: Sequence[Frame], maps: Sequence[DepthMap]) -> tuple[np.ndarray, float]:
    """Centre and radius of the sphere for points too distant to have a measurable depth.

    Depth maps that cannot resolve the distance would put a point at different places; on one sphere they agree.
    """
    centres = np.array([keyframe.camera.centre for keyframe in keyframes])
    centre = centres.mean(axis=0)
    extent = float(np.linalg.norm(centres - centre, axis=1).max())
    return centre, max(float(np.median([map_.resolved for map_ in maps])), SHELL_EXTENT * extent)


def _depths_on_shell(origin: np.ndarray, rays: np.ndarray, centre: np.ndarray, radius: float) -> np.ndarray:
    """(N,) scale factors that put the ends of (N, 3) rays from a point inside a sphere onto the sphere."""
    offset = origin - centre
    square, half = np.sum(rays * rays, axis=1), rays @ offset
    return (np.sqrt(half**2 + square * (radius**2 - offset @ offset)) - half) / square
