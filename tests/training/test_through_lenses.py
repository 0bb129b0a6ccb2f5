"""Training on photographs taken through a lens."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from mistakes import STRETCH
from pocketgs.capture import Capture
from pocketgs.capture.capture import Frame
from pocketgs.capture.synthetic.phone import quantised
from pocketgs.capture.synthetic.room import room
from pocketgs.capture.synthetic.walk import true_camera
from pocketgs.geometry.camera import Camera
from pocketgs.geometry.lens import Lens
from pocketgs.metrics.evaluation import psnr
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.rendering import render_frame
from pocketgs.training.options import TrainingOptions
from pocketgs.training.preparation import prepare
from pocketgs.training.train import train
from training.through_lens import expose_through

SIDE, VIEWS, HELD_OUT = 96, 16, (4, 11)
HALF_ANGLE = np.radians(85)
OPTIONS = TrainingOptions(iterations=200, max_gaussians=10_000, engine="cpu", evaluate_every=0, bundle=False)


def fisheye(camera: Camera) -> Camera:
    """The camera with a fisheye lens of 170 degrees from edge to edge."""
    return replace(camera, lens=Lens("fisheye", (0.0, 0.0, 0.0, 0.0)))


@cache
def room_through(change: Callable[[Camera], Camera]) -> Capture:
    """Photographs of the demo's room, with the central resolution of a fisheye of 170 degrees."""
    focal, frames = SIDE / 2 / HALF_ANGLE, []
    for number, time in enumerate(np.linspace(*STRETCH, VIEWS).tolist()):
        pose = true_camera(time, SIDE, SIDE).world_to_camera
        camera = change(Camera(SIDE, SIDE, focal, focal, SIDE / 2, SIDE / 2, pose))
        light, covered = expose_through(room(), camera, 3 * SIDE // 2)
        frames.append(Frame(f"{number:02d}.png", camera, quantised(np.sqrt(light)), mask=covered))
    held_out = [frames[number] for number in HELD_OUT]
    train_frames = [frame for number, frame in enumerate(frames) if number not in HELD_OUT]
    return Capture("room", Path("room"), "demo", train_frames, held_out, metric=True, protocol="synthetic")


def test_exposure_is_compensated_behind_a_lens() -> None:
    """Measured on undistorted copies, undone in the photographs themselves."""
    room = room_through(fisheye)
    exposed = [
        replace(frame, image=np.rint(np.clip(frame.image * gain, 0, 255)).astype(np.uint8))
        for frame, gain in zip(room.train, np.resize([0.8, 1.2], len(room.train)), strict=True)
    ]
    prepared = prepare(replace(room, train=exposed), replace(OPTIONS, prior="sparse"))
    assert prepared.report is not None
    assert prepared.report.gains is not None
    np.testing.assert_allclose(prepared.report.gains[1::2].mean() / prepared.report.gains[::2].mean(), 1.5, rtol=0.05)
    for frame, original in zip(prepared.train, room.train, strict=True):
        assert frame.camera.lens == original.camera.lens
        grey = (original.image > 40) & (original.image < 180)
        ratio = np.median(frame.image[grey] / original.image[grey])
        assert ratio == pytest.approx(1.0, abs=0.06)


def held_out_psnr(capture: Capture) -> float:
    engine = CpuEngine()
    train(capture, OPTIONS, opened_engine=engine)
    images = [render_frame(engine, frame, (0.0, 0.0, 0.0)) for frame in capture.held_out]
    pairs = zip(images, capture.held_out, strict=True)
    return float(np.mean([psnr(image, frame.image / 255.0, frame.mask) for image, frame in pairs]))


@pytest.mark.slow
def test_a_fisheye_of_170_degrees_trains_as_well_as_a_pinhole() -> None:
    pinhole = held_out_psnr(room_through(lambda camera: camera))
    through_fisheye = held_out_psnr(room_through(fisheye))
    print(f"pinhole {pinhole:.2f} dB, fisheye {through_fisheye:.2f} dB")
    assert pinhole > 26.0
    assert through_fisheye > pinhole - 0.3
