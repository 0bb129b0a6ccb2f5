"""Sparse clouds, triangulated by COLMAP at known poses."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.spatial import cKDTree

from pocketgs.capture.capture import Frame
from pocketgs.capture.formats.colmap_files import read_points
from pocketgs.errors import PocketGSError
from pocketgs.scene.point_cloud import PointCloud
from pocketgs.structure_from_motion.colmap.triangulation_job import TriangulationJob
from pocketgs.structure_from_motion.process import check_installed, run_colmap, threads_that_fit

MAX_PARTNERS = 30
"""Number of nearest images that each image is matched with: all of them for a capture of 31 photographs."""

SEEDS = 2**31
"""Number of random seeds that COLMAP has."""


def triangulate(
    frames: Sequence[Frame], seed: int = 0, on_stage: Callable[[str], None] = lambda stage: None
) -> PointCloud:
    """Extract features, match and triangulate them with COLMAP, at the frames' poses.

    Pixels that masks and alpha leave out have no features.

    Args:
        frames: at least two, undistorted, with distinct camera centres.
        seed: random seed.
        on_stage: called with "features", "matching" and "triangulation" when they begin.

    Returns:
        Points in the frames' world, with colours; none if nothing could be matched.

    Raises:
        PocketGSError: pycolmap is missing or failed, or there are fewer than two frames.
    """
    if len(frames) < 2:
        raise PocketGSError(f"a sparse cloud of {len(frames)} photographs: expected at least two")
    check_installed()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run_colmap("triangulation", _job(frames, folder, seed), folder / "log.txt", on_stage)
        points = read_points(folder / "model")
    return points if points is not None else PointCloud(np.zeros((0, 3)), np.zeros((0, 3)))


def partners(centres: np.ndarray, most: int = MAX_PARTNERS) -> list[tuple[int, int]]:
    """Pairs of frames to match: each with its nearest neighbours.

    Args:
        centres: (N, 3) camera centres.
        most: neighbours per frame; a frame may be in more pairs, as a neighbour of others.

    Returns:
        Pairs of indices, the smaller first, sorted and unique.
    """
    _, nearest = cKDTree(centres).query(centres, k=min(most + 1, len(centres)))
    pairs = {(min(i, int(j)), max(i, int(j))) for i, row in enumerate(np.atleast_2d(nearest)) for j in row if i != j}
    return sorted(pairs)


def _job(frames: Sequence[Frame], folder: Path, seed: int) -> TriangulationJob:
    """The job, with its images written to a folder: COLMAP reads files."""
    images, model, pairs = folder / "images", folder / "model", folder / "pairs.txt"
    images.mkdir()
    model.mkdir()
    names = [f"{number:06d}.png" for number in range(len(frames))]
    for frame, name in zip(frames, names, strict=True):
        Image.fromarray(frame.image).save(images / name, compress_level=1)
    chosen = partners(np.array([frame.camera.centre for frame in frames]))
    pairs.write_text("".join(f"{names[i]} {names[j]}\n" for i, j in chosen), encoding="ascii")
    cameras = [frame.camera for frame in frames]
    return {
        "images": str(images),
        "masks": _masks(frames, names, folder / "masks"),
        "model": str(model),
        "pairs": str(pairs),
        "database": str(folder / "database.db"),
        "cameras": {
            name: {
                "size": [camera.width, camera.height],
                "intrinsics": [camera.fx, camera.fy, camera.cx, camera.cy],
                "world_to_camera": camera.world_to_camera[:3].tolist(),
            }
            for name, camera in zip(names, cameras, strict=True)
        },
        "max_size": max(max(camera.width, camera.height) for camera in cameras),
        "threads": threads_that_fit(max(camera.width * camera.height for camera in cameras)),
        "seed": seed % SEEDS,
    }


def _masks(frames: Sequence[Frame], names: Sequence[str], folder: Path) -> str | None:
    """Write the frames' masks to a folder, under COLMAP's names; None if no frame has one.

    COLMAP leaves out images that lack one, so if any frame has a mask, all get one.
    """
    if all(frame.usable is None for frame in frames):
        return None
    folder.mkdir()
    for frame, name in zip(frames, names, strict=True):
        usable = np.ones(frame.image.shape[:2], bool) if frame.usable is None else frame.usable
        Image.fromarray(255 * usable.astype(np.uint8)).save(folder / f"{name}.png", compress_level=1)
    return str(folder)
