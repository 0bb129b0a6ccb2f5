"""Photographs of a synthetic scene through any lens, sampled from pinhole views in five directions."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from pocketgs.capture.synthetic.phone import expose
from pocketgs.capture.synthetic.tracing import Scene
from pocketgs.geometry.camera import Camera

SAMPLES = 4
"""Rays per pixel of the pinhole views."""

FINER = 3
"""Samples along a side of each pixel of the photograph."""

TURNS = ((0.0, 0.0), (0.0, 90.0), (0.0, -90.0), (90.0, 0.0), (-90.0, 0.0))
"""Degrees about the camera's x and y axis by which the five views of 90 degrees are turned."""


def expose_through(scene: Scene, camera: Camera, face: int) -> tuple[np.ndarray, np.ndarray]:
    """Expose a photograph through the camera's lens.

    Args:
        scene: to photograph.
        camera: of any lens.
        face: width and height of the pinhole views that it is sampled from, in pixels.

    Returns:
        (H, W, 3) float32 linear light, and (H, W) bool: the pixels that the five views cover, which are all up to 90
        degrees from the optical axis, and more to the sides.
    """
    height, width = camera.height * FINER, camera.width * FINER
    at_origin = replace(camera.resized(width, height), world_to_camera=np.eye(4))
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    rays = at_origin.rays(np.stack([x.ravel(), y.ravel()], axis=1)).reshape(height, width, 3)
    light, covered = np.zeros((height, width, 3), np.float32), np.zeros((height, width), np.bool_)
    for turn in TURNS:
        axes = cv2.Rodrigues(np.radians([*turn, 0.0]))[0]
        local = rays @ axes
        ahead = local[..., 2] > 0
        slopes = local[..., :2] / np.where(ahead, local[..., 2], 1.0)[..., None]
        inside = ahead & (np.abs(slopes) <= 1.0).all(axis=2) & ~covered
        pixels = ((slopes + 1.0) * (face / 2) - 0.5).astype(np.float32)
        view = _view(scene, camera, axes, face)
        sampled = cv2.remap(view, pixels[..., 0], pixels[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        light[inside] = sampled[inside]
        covered |= inside
    return _reduced(light), _reduced(covered[..., None].astype(np.float32))[..., 0] == 1.0


def _view(scene: Scene, camera: Camera, axes: np.ndarray, face: int) -> np.ndarray:
    """(face, face, 3) light of a view of 90 degrees, whose axes are given in the camera's."""
    pose = camera.camera_to_world[:3].copy()
    pose[:, :3] = pose[:, :3] @ axes
    half = face / 2
    light, _ = expose(scene, Camera(face, face, half, half, half, half, np.eye(4)), np.repeat(pose[None], SAMPLES, 0))
    return light


def _reduced(image: np.ndarray) -> np.ndarray:
    """Means over the samples of each pixel."""
    height, width = image.shape[:2]
    return np.asarray(image.reshape(height // FINER, FINER, width // FINER, FINER, -1).mean(axis=(1, 3)))
