"""Random points in the volume that the cameras see together, for captures without a cloud.

Not a reconstruction, but a far better start than a uniform cube: each point is drawn on the ray of a random pixel, at
the one of a few dozen depths where neighbouring photographs agree best with the pixel's surroundings.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.geometry.camera_geometry import focus_point, looks_at
from pocketgs.prior.cloud.visual_hull import outside_hull
from pocketgs.scene.point_cloud import PointCloud

NEAREST, FARTHEST, DEPTHS = 0.5, 3.0, 48
"""Depths to test, as multiples of the distance to the focus point, evenly spaced in inverse depth."""

NEIGHBOURS = 4
BEST_ANGLE = np.radians(10)
"""A pixel is compared in this many frames, those whose viewing angle to the scene is closest to this."""

PATCH = np.array([[0, 0], [-2, 0], [2, 0], [0, -2], [0, 2]])
"""Pixel offsets of the patch to compare."""

KEPT = 0.6
"""Share of the rays to keep: those whose best depth is most distinct."""

MIN_POINTS = 4


def draw_points(frames: Sequence[Frame], count: int, seed: int = 0) -> PointCloud:
    """Draw random points where the photographs agree.

    Transparent pixels are skipped, and so are points that project to transparent pixels of any image.

    Args:
        frames: training frames.
        count: number of points.
        seed: random seed.

    Returns:
        At most `count` points with the colours of their pixels.

    Raises:
        PocketGSError: no volume is seen by several cameras.
    """
    rng = np.random.default_rng(seed)
    cameras = [frame.camera for frame in frames]
    focus = focus_point(cameras)
    if len(frames) > 1 and not looks_at(cameras, focus):
        raise PocketGSError(
            f"the {len(frames)} cameras face outwards and there is no cloud: expected a capture with points"
        )
    rays = -(-int(count / KEPT) // len(frames))
    drawn = [_draw_from(frame, _neighbours(frame, frames, focus), focus, rays, rng) for frame in frames]
    positions, colours, rivals = (np.concatenate(arrays) for arrays in zip(*drawn, strict=True))
    solid = np.flatnonzero(~outside_hull(positions, frames))
    if len(solid) < MIN_POINTS:
        raise PocketGSError(
            f"no volume is seen by several of the {len(frames)} cameras: are the poses right, and does each photograph "
            "show something, not masked or transparent?"
        )
    best = solid[np.argsort(rivals[solid], kind="stable")[:count]]
    return PointCloud(positions[best], colours[best])


def _neighbours(frame: Frame, frames: Sequence[Frame], focus: np.ndarray) -> list[Frame]:
    """The frames to compare a frame with."""

    def direction(camera: Camera) -> np.ndarray:
        offset = camera.centre - focus
        return offset / max(float(np.linalg.norm(offset)), 1e-12)

    def misfit(other: Frame) -> float:
        cosine = np.clip(direction(frame.camera) @ direction(other.camera), -1.0, 1.0)
        return float(abs(np.arccos(cosine) - BEST_ANGLE))

    return sorted((other for other in frames if other is not frame), key=misfit)[:NEIGHBOURS]


def _draw_from(
    frame: Frame, neighbours: list[Frame], focus: np.ndarray, rays: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points on random rays of one frame.

    Returns:
        (M, 3) positions, (M, 3) colours, and (M,) ratio of the best cost to the typical one: small where the choice is
        clear.
    """
    camera = frame.camera
    pixels = _random_pixels(frame, rays, rng)
    distance = abs(float((focus - camera.centre) @ camera.forward)) or 1.0
    inverse = np.linspace(1.0 / FARTHEST, 1.0 / NEAREST, DEPTHS)
    # Each ray's depths are jittered within their spacing, so that points do not lie in layers.
    shift = (inverse[1] - inverse[0]) * rng.uniform(-0.5, 0.5, (len(pixels), 1))
    depths = (distance / (inverse + shift)).astype(np.float32)
    costs = _costs(frame, neighbours, pixels, depths)
    rows, best = np.arange(len(pixels)), np.argmin(costs, axis=1)
    least = costs[rows, best]
    seen = np.isfinite(least)
    compared = np.where(np.isfinite(costs[seen]), costs[seen], np.nan)
    typical = np.nanmedian(compared, axis=1) if seen.any() else least[seen]
    positions = _unproject(camera, pixels[seen], depths[rows, best][seen])
    colours = frame.image[pixels[seen, 1], pixels[seen, 0]] / np.float32(255.0)
    # One grey level is added so that noise on even surfaces does not look like a clear choice.
    return positions, colours, (least[seen] + 1.0) / (typical + 1.0)


def _random_pixels(frame: Frame, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 2) column and row of pixels that are neither transparent nor masked."""
    height, width = frame.image.shape[:2]
    usable = np.ones((height, width), bool)
    if frame.alpha is not None:
        usable &= frame.alpha > 0
    if frame.mask is not None:
        usable &= frame.mask
    chosen = np.flatnonzero(usable)
    if len(chosen) == 0:
        return np.zeros((0, 2), int)
    rows, columns = np.divmod(rng.choice(chosen, count), width)
    return np.stack([columns, rows], axis=1)


def _unproject(camera: Camera, pixels: np.ndarray, depths: np.ndarray) -> np.ndarray:
    return camera.rays(pixels + 0.5) * depths[:, None] + camera.centre


def _costs(frame: Frame, neighbours: list[Frame], pixels: np.ndarray, depths: np.ndarray) -> np.ndarray:
    """(M, D) mean absolute difference, in grey levels, of patches around pixels and their projections in neighbours.

    Infinite where fewer than two neighbours (or all, if there are fewer) see the whole patch.
    """
    total, views = np.zeros(depths.shape, np.float32), np.zeros(depths.shape, np.int16)
    last = np.array(frame.image.shape[1::-1]) - 1
    for offset in PATCH:
        around = np.clip(pixels + offset, 0, last)
        own = frame.image[around[:, 1], around[:, 0]].astype(np.int16)
        directions = frame.camera.rays(around + 0.5)
        for other in neighbours:
            inside, index = _pixels_of(other.camera, frame.camera.centre, directions, depths)
            if other.mask is not None:
                inside &= other.mask.reshape(-1)[index]
            if frame.mask is not None:
                inside &= frame.mask[around[:, 1], around[:, 0], None]
            theirs = other.image.reshape(-1, 3).take(index, axis=0)
            total += np.abs(theirs - own[:, None]).sum(axis=2) * inside
            views += inside
    needed = len(PATCH) * min(2, max(len(neighbours), 1))
    return np.where(views >= needed, total / (3 * np.maximum(views, 1)), np.inf)


def _pixels_of(
    camera: Camera, origin: np.ndarray, directions: np.ndarray, depths: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Whether a camera sees the points origin + depth · direction, and their pixel indices; both (M, D)."""
    rotation, translation = camera.world_to_camera[:3, :3], camera.world_to_camera[:3, 3]
    x, y, z = (directions @ rotation.T).astype(np.float32).T[:, :, None]
    start_x, start_y, start_z = (rotation @ origin + translation).astype(np.float32)
    depth = z * depths + start_z
    in_front = depth > 0
    depth[~in_front] = 1.0
    column = np.float32(camera.fx) * (x * depths + start_x) / depth + np.float32(camera.cx)
    row = np.float32(camera.fy) * (y * depths + start_y) / depth + np.float32(camera.cy)
    inside = in_front & (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    index = np.where(inside, row, 0).astype(np.int32) * camera.width + np.where(inside, column, 0).astype(np.int32)
    return inside, index
