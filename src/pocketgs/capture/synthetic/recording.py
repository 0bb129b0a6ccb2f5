"""The demo capture in memory: as recorded by the phone, its ground truth, and an error-free capture for tests."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pocketgs.capture.capture import Capture, Frame
from pocketgs.capture.synthetic.phone import (
    HOLD_OUT_EVERY,
    Shot,
    expose,
    photograph,
    plan_shots,
    quantised,
)
from pocketgs.capture.synthetic.room import room
from pocketgs.capture.synthetic.walk import true_camera
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.scene.point_cloud import PointCloud

STRETCH = (8.0, 15.0)
"""Seconds of the walk that `true_capture` covers: 45 degrees of the arc."""

CLEAN_SAMPLES = 16

POINT_NOISE = 0.004


@dataclass(frozen=True)
class GroundTruth:
    """The ground truth of the demo capture.

    Attributes:
        cameras: true camera of every frame, by frame name.
        depths: by frame name, (H, W) float32 metres along the optical axis at pixel centres from the true pose, 0 where
            there is no surface.
    """

    cameras: dict[str, Camera]
    depths: dict[str, np.ndarray]


def demo_capture(width: int = 480, height: int = 360, frames: int = 120) -> Capture:
    """Make the demo capture: a phone's recording of a 50 s walk around a table. Deterministic.

    Poses are the phone's, with drift; there are no points and no depths. Lengths are metres, z is up.

    Args:
        width: of the images, in pixels.
        height: of the images, in pixels.
        frames: number of images, spread over the whole walk; every eighth, from the first, is held out.

    Raises:
        PocketGSError: a size is not positive or fewer than two frames are asked for.
    """
    recorded = [(shot, Frame(frame_name(shot), shot.sensed, image)) for shot, image, _ in record(width, height, frames)]
    return Capture(
        name="demo",
        path=Path("demo"),
        format="demo",
        train=[frame for shot, frame in recorded if not shot.held_out],
        held_out=[frame for shot, frame in recorded if shot.held_out],
        metric=True,
        protocol=f"synthetic, {width}x{height}, every {HOLD_OUT_EVERY}th frame held out",
    )


def demo_ground_truth(width: int = 480, height: int = 360, frames: int = 120) -> GroundTruth:
    """The true cameras and depths of `demo_capture` of the same size.

    Raises:
        PocketGSError: as `demo_capture`.
    """
    check_sizes(width, height, frames)
    scene, shots = room(), plan_shots(width, height, frames)
    return GroundTruth(
        cameras={frame_name(shot): shot.camera for shot in shots},
        depths={frame_name(shot): expose(scene, shot.camera, shot.poses[:1])[1] for shot in shots},
    )


def record(width: int, height: int, frames: int) -> Iterator[tuple[Shot, np.ndarray, np.ndarray]]:
    """Take the demo's shots one by one: each with its (H, W, 3) uint8 image and (H, W) float32 true depth in metres.

    Raises:
        PocketGSError: as `demo_capture`.
    """
    check_sizes(width, height, frames)
    scene = room()
    for shot in plan_shots(width, height, frames):
        yield shot, *photograph(scene, shot)


def frame_name(shot: Shot) -> str:
    """Name of a shot's frame: the path of its image in the capture's folder."""
    return f"images/{shot.index:04d}.png"


def true_capture(width: int = 320, height: int = 240, frames: int = 24, points: int = 6000) -> Capture:
    """A short part of the walk without the phone's errors: exact poses, clean images, depths and a point cloud.

    Args:
        width: of the images, in pixels.
        height: of the images, in pixels.
        frames: number of images, spread over 7 s of the walk; every eighth, from the first, is held out.
        points: size of the point cloud, seen by training frames only; positions have noise of 4 mm standard deviation
            per axis.

    Raises:
        PocketGSError: a size is not positive or fewer than two frames are asked for.
    """
    check_sizes(width, height, frames)
    if points < 1:
        raise PocketGSError(f"demo capture: {points} points, expected at least one")
    scene = room()
    clean = []
    for index, time in enumerate(np.linspace(*STRETCH, frames).tolist()):
        camera = true_camera(time, width, height)
        light, depth = expose(scene, camera, np.repeat(camera.camera_to_world[None, :3], CLEAN_SAMPLES, axis=0))
        clean.append(Frame(f"{index:04d}.png", camera, quantised(np.sqrt(light)), depth=depth))
    train = [frame for index, frame in enumerate(clean) if index % HOLD_OUT_EVERY]
    return Capture(
        name="demo",
        path=Path("demo"),
        format="demo",
        train=train,
        held_out=clean[::HOLD_OUT_EVERY],
        points=_scan(train, points),
        metric=True,
        protocol=f"synthetic, {width}x{height}, exact poses, every {HOLD_OUT_EVERY}th frame held out",
    )


def check_sizes(width: int, height: int, frames: int) -> None:
    """Raise PocketGSError unless a demo capture can have these sizes."""
    if width < 1 or height < 1:
        raise PocketGSError(f"demo capture: {width}x{height} pixels, expected at least one of each")
    if frames < 2:
        raise PocketGSError(f"demo capture: {frames} frames, expected at least 2, as the first is held out")


def _scan(frames: list[Frame], count: int) -> PointCloud:
    """`count` points of the depth maps, spread evenly over frames and pixels, with the noise of a phone's scan."""
    generator = np.random.default_rng(7)
    positions, colours = [], []
    for number, frame in enumerate(frames):
        assert frame.depth is not None
        share = count * (number + 1) // len(frames) - count * number // len(frames)
        row, column = np.unravel_index(generator.integers(0, frame.depth.size, share), frame.depth.shape)
        rays = frame.camera.rays(np.column_stack([column, row]) + 0.5)
        positions.append(frame.camera.centre + rays * frame.depth[row, column, None])
        colours.append(frame.image[row, column] / 255)
    noise = generator.normal(0, POINT_NOISE, (count, 3))
    return PointCloud(np.concatenate(positions) + noise, np.concatenate(colours))
