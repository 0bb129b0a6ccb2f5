"""Small bundle adjustment problems whose solution is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from pocketgs.geometry.camera import Camera, look_at
from pocketgs.prior.features.observations import Observations


@dataclass(frozen=True, eq=False)
class Problem:
    """Ground truth, observations, and a perturbed start."""

    true_cameras: list[Camera]
    true_points: np.ndarray
    cameras: list[Camera]
    points: np.ndarray
    observations: Observations


def make_problem(
    frames: int = 6,
    points: int = 60,
    views: int = 4,
    noise: float = 0.0,
    pose_error: float = 0.02,
    point_error: float = 0.05,
    seed: int = 0,
) -> Problem:
    """Cameras on an arc around a cube of points.

    Args:
        frames: number of cameras.
        points: number of points.
        views: cameras that see each point.
        noise: standard deviation of what was seen, in pixels.
        pose_error: that of the start's rotations (radians) and centres (scene units, the arc's radius is 4).
        point_error: that of the start's points.
        seed: of everything random.
    """
    rng = np.random.default_rng(seed)
    true_points = rng.uniform(-1.0, 1.0, (points, 3))
    true_cameras = []
    for angle in np.linspace(-0.7, 0.7, frames):
        eye = np.array([4.0 * np.sin(angle), rng.uniform(-0.5, 0.5), -4.0 * np.cos(angle)])
        pose = look_at(eye, rng.normal(0.0, 0.1, 3), np.array([0.0, -1.0, 0.0]))
        true_cameras.append(Camera(640, 480, 500.0, 520.0, 318.0, 243.0, pose))
    frame = np.concatenate([rng.choice(frames, views, replace=False) for _ in range(points)]).astype(np.int32)
    point = np.repeat(np.arange(points, dtype=np.int32), views)
    shuffled = rng.permutation(len(frame))
    seen = Observations(frame[shuffled], point[shuffled], np.zeros((len(frame), 2)))
    pixels = predicted(true_cameras, true_points, seen) + rng.normal(0.0, noise, seen.pixels.shape)
    start = [turned_and_moved(camera, *rng.normal(0.0, pose_error, (2, 3))) for camera in true_cameras]
    start_points = true_points + rng.normal(0.0, point_error, true_points.shape)
    return Problem(true_cameras, true_points, start, start_points, replace(seen, pixels=pixels))


def turned_and_moved(camera: Camera, turn: np.ndarray, offset: np.ndarray) -> Camera:
    """The camera with rotation exp(turn)·R and centre c + offset."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ camera.world_to_camera[:3, :3]
    pose[:3, 3] = -pose[:3, :3] @ (camera.centre + offset)
    return replace(camera, world_to_camera=pose)


def predicted(cameras: Sequence[Camera], points: np.ndarray, observations: Observations) -> np.ndarray:
    """(M, 2) pixels where the points should be seen, in plain NumPy."""
    rotations = np.array([camera.world_to_camera[:3, :3] for camera in cameras])
    intrinsics = np.array([[camera.fx, camera.fy, camera.cx, camera.cy] for camera in cameras])[observations.frame]
    offsets = points[observations.point] - centres(cameras)[observations.frame]
    local = np.einsum("kij,kj->ki", rotations[observations.frame], offsets)
    return intrinsics[:, :2] * (local[:, :2] / local[:, 2:]) + intrinsics[:, 2:]


def centres(cameras: Sequence[Camera]) -> np.ndarray:
    """(F, 3) positions of the cameras."""
    return np.array([camera.centre for camera in cameras])


def similarity(source: np.ndarray, target: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Scale s, rotation R and offset t for which s·R·x + t takes `source` (N, 3) closest to `target`: Umeyama 1991."""
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    left, singular, right = np.linalg.svd((target - target_mean).T @ (source - source_mean))
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    rotation = left @ np.diag(signs) @ right
    scale = float(singular @ signs / np.sum((source - source_mean) ** 2))
    return scale, rotation, target_mean - scale * rotation @ source_mean


def position_errors(cameras: Sequence[Camera], true_cameras: Sequence[Camera]) -> np.ndarray:
    """(F,) distances of centres from the true ones after similarity alignment."""
    scale, rotation, offset = similarity(centres(cameras), centres(true_cameras))
    return np.linalg.norm(scale * centres(cameras) @ rotation.T + offset - centres(true_cameras), axis=1)


def pose_errors(
    cameras: Sequence[Camera], points: np.ndarray, true_cameras: Sequence[Camera], true_points: np.ndarray
) -> tuple[float, float]:
    """The largest error of a centre and of a rotation (radians) once points and centres are aligned by a similarity."""
    scale, rotation, offset = similarity(
        np.concatenate([points, centres(cameras)]), np.concatenate([true_points, centres(true_cameras)])
    )
    moved = scale * centres(cameras) @ rotation.T + offset
    distance = np.linalg.norm(moved - centres(true_cameras), axis=1).max()
    turns = [
        Rotation.from_matrix(camera.world_to_camera[:3, :3] @ rotation.T @ true.world_to_camera[:3, :3].T).magnitude()
        for camera, true in zip(cameras, true_cameras, strict=True)
    ]
    return float(distance), float(max(turns))
