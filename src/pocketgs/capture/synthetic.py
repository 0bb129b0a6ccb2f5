"""The built-in demo capture: toys in the corner of a room, ray-cast from known cameras, with its ground truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pocketgs.camera import Camera, look_at
from pocketgs.capture import materials
from pocketgs.capture.capture import Capture, Frame
from pocketgs.capture.surfaces import Ball, Cube, Plane, Surface
from pocketgs.errors import PocketGSError
from pocketgs.pointcloud import PointCloud

HOLD_OUT_EVERY = 8
POINT_NOISE = 0.004
FIELD_OF_VIEW = np.radians(58)
LOOK_AT = np.array([-0.12, 0.12, 0.26])
TOWARDS_SUN = np.array([[0.43], [-0.52], [0.74]], np.float32)
SUNLIGHT = np.array([[0.9], [0.84], [0.72]], np.float32)
SKYLIGHT = np.array([[0.42], [0.46], [0.52]], np.float32)
RAYS_AT_ONCE = 1 << 14  # keeps the intermediate arrays in cache


def demo_capture(width: int = 320, height: int = 240, frames: int = 24, points: int = 6000) -> Capture:
    """Render the demo capture: a hand-held walk along an arc before a room corner with four balls and a cube.

    Everything is known exactly: poses, intrinsics and the depth of every pixel centre. Lengths are metres, z is up.
    Every call gives the same capture.

    Args:
        width: of the images, in pixels.
        height: of the images, in pixels.
        frames: number of images; every eighth, from the first, is held out.
        points: size of the coarse point cloud, which only training frames have seen.

    Returns:
        A metric capture with depth maps. The cloud's positions carry noise of 4 mm standard deviation on each axis.

    Raises:
        PocketGSError: a size is not positive or fewer than two frames are asked for.
    """
    if width < 1 or height < 1 or points < 1:
        raise PocketGSError(f"demo capture: {width}x{height} pixels and {points} points, expected at least one of each")
    if frames < 2:
        raise PocketGSError(f"demo capture: {frames} frames, expected at least 2, as the first is held out")
    surfaces = _room()
    cameras = [_walk(index / (frames - 1), width, height) for index in range(frames)]
    rendered = [_photograph(f"{index:04d}.png", camera, surfaces) for index, camera in enumerate(cameras)]
    train = [frame for index, frame in enumerate(rendered) if index % HOLD_OUT_EVERY]
    return Capture(
        name="demo",
        path=Path("demo"),
        format="demo",
        train=train,
        held_out=rendered[::HOLD_OUT_EVERY],
        points=_scan(train, points),
        metric=True,
        protocol=f"synthetic, {width}x{height}, exact poses, every {HOLD_OUT_EVERY}th frame held out",
    )


def _room() -> list[Surface]:
    def at(x: float, y: float, z: float) -> np.ndarray:
        return np.array([[x], [y], [z]], np.float32)

    cosine, sine = np.cos(np.radians(28)), np.sin(np.radians(28))
    cube_axes = np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]], np.float32)
    return [
        Plane(at(0, 0, 0), at(0, 0, 1), materials.oak_floor),
        Plane(at(0, 0.95, 0), at(0, -1, 0), materials.brick_wall),
        Plane(at(-0.95, 0, 0), at(1, 0, 0), materials.dotted_wallpaper),
        Ball(at(-0.42, 0.42, 0.3), 0.3, materials.beach_ball),
        Ball(at(0.3, 0.45, 0.2), 0.2, materials.marble),
        Ball(at(-0.5, -0.25, 0.18), 0.18, materials.turned_wood),
        Ball(at(-0.06, -0.3, 0.13), 0.13, materials.chequered_ball),
        Cube(at(0.02, 0.08, 0.11), 0.11, cube_axes, materials.puzzle_cube),
    ]


def _walk(progress: float, width: int, height: int) -> Camera:
    """Camera at `progress` in [0, 1] of the arc; sines that never fall into step stand for an unsteady hand."""
    azimuth = np.radians(-45 + 60 * (progress - 0.5))
    distance = 1.75 + 0.1 * np.sin(7 * progress)
    eye_height = 0.8 + 0.22 * np.sin(9.5 * progress + 0.5)
    eye = np.array([distance * np.cos(azimuth), distance * np.sin(azimuth), eye_height])
    sway = 0.04 * np.sin([17 * progress, 23 * progress + 1, 29 * progress + 2])
    up = np.array([0.03 * np.sin(13 * progress), 0.03 * np.cos(11 * progress), 1.0])
    focal = float(0.5 * width / np.tan(FIELD_OF_VIEW / 2))
    return Camera(width, height, focal, focal, width / 2, height / 2, look_at(eye, LOOK_AT + sway, up))


def _photograph(name: str, camera: Camera, surfaces: list[Surface]) -> Frame:
    """Colour is the mean over 2x2 rays a pixel; depth is that of the ray through the pixel's centre."""
    height, width = camera.height, camera.width
    eye = camera.centre.astype(np.float32)[:, None]
    fine_rays = _ray_directions(camera.resized(2 * width, 2 * height))
    starts = range(0, fine_rays.shape[1], RAYS_AT_ONCE)
    colours = np.hstack([_shade(eye, fine_rays[:, start : start + RAYS_AT_ONCE], surfaces) for start in starts])
    pixels = colours.reshape(3, height, 2, width, 2).mean(axis=(2, 4))
    image = np.ascontiguousarray(np.round(255 * pixels).astype(np.uint8).transpose(1, 2, 0))
    depth, _ = _nearest(eye, _ray_directions(camera), surfaces)
    return Frame(name, camera, image, depth=depth.reshape(height, width))


def _ray_directions(camera: Camera) -> np.ndarray:
    """(3, H·W) float32 directions in the world, of length 1 along the optical axis: t along a ray is depth."""
    row, column = np.indices((camera.height, camera.width)).reshape(2, -1) + 0.5
    local = np.stack([(column - camera.cx) / camera.fx, (row - camera.cy) / camera.fy, np.ones_like(row)])
    return (camera.world_to_camera[:3, :3].T @ local).astype(np.float32)


def _nearest(origins: np.ndarray, directions: np.ndarray, surfaces: list[Surface]) -> tuple[np.ndarray, np.ndarray]:
    """(N,) t of the first hit, inf for none, and (N,) index of the surface hit."""
    distances = np.stack([surface.hit(origins, directions) for surface in surfaces])
    return distances.min(axis=0), distances.argmin(axis=0)


def _shade(eye: np.ndarray, directions: np.ndarray, surfaces: list[Surface]) -> np.ndarray:
    """(3, N) colours in [0, 1]: matt surfaces under a sky and a sun that casts shadows, the same from every view."""
    distance, index = _nearest(eye, directions, surfaces)
    points = eye + directions * distance
    albedo, normals = np.empty_like(points), np.empty_like(points)
    for number, surface in enumerate(surfaces):
        here = np.flatnonzero(index == number)
        albedo[:, here] = surface.colours(points[:, here])
        normals[:, here] = surface.normals(points[:, here])
    # Start a little off the surface, so that rounding does not let it shade itself.
    obstacle, _ = _nearest(points + 1e-3 * normals, TOWARDS_SUN, surfaces)
    sun = np.maximum((normals * TOWARDS_SUN).sum(axis=0), 0) * np.isinf(obstacle)
    sky = 0.75 + 0.25 * normals[2]
    return np.clip(albedo * (sun * SUNLIGHT + sky * SKYLIGHT), 0, 1)


def _scan(frames: list[Frame], count: int) -> PointCloud:
    """`count` points of the depth maps, spread evenly over frames and pixels, with noise as a phone's scan has."""
    generator = np.random.default_rng(7)
    positions, colours = [], []
    for number, frame in enumerate(frames):
        assert frame.depth is not None
        share = count * (number + 1) // len(frames) - count * number // len(frames)
        pixels = generator.integers(0, frame.depth.size, share)
        reach = _ray_directions(frame.camera)[:, pixels] * frame.depth.ravel()[pixels]
        positions.append(frame.camera.centre + reach.T)
        colours.append(frame.image.reshape(-1, 3)[pixels] / 255)
    noise = generator.normal(0, POINT_NOISE, (count, 3))
    return PointCloud(np.concatenate(positions) + noise, np.concatenate(colours))
