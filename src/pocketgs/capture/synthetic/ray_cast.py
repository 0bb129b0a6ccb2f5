"""The demo's ray caster: one parallel kernel that renders an image and its depths."""

from __future__ import annotations

import math

import numba
import numpy as np

from pocketgs.capture.synthetic.light import light_along, towards_sun
from pocketgs.capture.synthetic.shapes import Vector, dot, unit_vector
from pocketgs.capture.synthetic.tracing import Scene, nearest
from pocketgs.system.compile import parallel_kernel, part

TILE = 16  # pixels a side


@parallel_kernel
def ray_cast(scene: Scene, focal: float, poses: np.ndarray, light: np.ndarray, depth: np.ndarray) -> None:
    """Render the scene with one ray per pixel and pose.

    Args:
        scene: to render.
        focal: focal length in pixels; the principal point is the image centre.
        poses: (S, 3, 4) camera-to-world poses during the exposure, OpenCV axes.
        light: (H, W, 3) float32 output, linear RGB averaged over the poses.
        depth: (H, W) float32 output, depth along the optical axis at pixel centres, from the first pose; 0 where
            nothing is hit.
    """
    height, width = depth.shape
    across, down = (width + TILE - 1) // TILE, (height + TILE - 1) // TILE
    share = 1 / len(poses)
    for tile in numba.prange(across * down):
        top, left = tile // across * TILE, tile % across * TILE
        bottom, right = min(top + TILE, height), min(left + TILE, width)
        candidates = np.empty(len(scene.shapes), np.int64)
        light[top:bottom, left:right] = 0
        for sample in range(len(poses)):
            pose = poses[sample]
            eye = (pose[0, 3], pose[1, 3], pose[2, 3])
            # Evenly spread over the pixel, starting at its centre, and over the sun's disc: R2 sequence (Roberts,
            # 2018).
            x, y = (0.5 + 0.7548776662466927 * sample) % 1, (0.5 + 0.5698402909980532 * sample) % 1
            sun = towards_sun(x, y)
            axis, cosine = _cone(pose, left - 0.5 * width, top - 0.5 * height, focal)
            count = _in_view(scene.bounds, eye, axis, cosine, candidates)
            for row in range(top, bottom):
                for column in range(left, right):
                    ray = _ray(pose, column + x - 0.5 * width, row + y - 0.5 * height, focal)
                    distance, index = nearest(scene, candidates, 0, count, eye, ray)
                    if sample == 0:
                        depth[row, column] = distance if index >= 0 else 0
                    red, green, blue = light_along(scene, eye, ray, distance, index, sun, 1 / focal)
                    light[row, column, 0] += share * red
                    light[row, column, 1] += share * green
                    light[row, column, 2] += share * blue


@part
def _cone(pose: np.ndarray, left: float, top: float, focal: float) -> tuple[Vector, float]:
    """The cone around a tile: its unit axis, and the cosine of its half angle."""
    axis = unit_vector(_ray(pose, left + 0.5 * TILE, top + 0.5 * TILE, focal))
    upper = min(
        dot(axis, unit_vector(_ray(pose, left, top, focal))),
        dot(axis, unit_vector(_ray(pose, left + TILE, top, focal))),
    )
    top += TILE
    lower = min(
        dot(axis, unit_vector(_ray(pose, left, top, focal))),
        dot(axis, unit_vector(_ray(pose, left + TILE, top, focal))),
    )
    return axis, min(upper, lower)


@part
def _in_view(bounds: np.ndarray, eye: Vector, axis: Vector, cosine: float, candidates: np.ndarray) -> int:
    """Collect the parts that intersect a cone with its apex at the eye; returns their number."""
    sine = math.sqrt(1 - cosine * cosine)
    count = 0
    for index in range(len(bounds)):
        ball = bounds[index]
        towards = (ball[0] - eye[0], ball[1] - eye[1], ball[2] - eye[2])
        forward = dot(towards, axis)
        sideways = math.sqrt(max(dot(towards, towards) - forward * forward, 0.0))
        if sideways * cosine - forward * sine < ball[3]:
            candidates[count] = index
            count += 1
    return count


@part
def _ray(pose: np.ndarray, right: float, down: float, focal: float) -> Vector:
    """World direction through an image position, with length 1 along the optical axis, so that t is depth."""
    x, y = right / focal, down / focal
    return (
        pose[0, 0] * x + pose[0, 1] * y + pose[0, 2],
        pose[1, 0] * x + pose[1, 1] * y + pose[1, 2],
        pose[2, 0] * x + pose[2, 1] * y + pose[2, 2],
    )
