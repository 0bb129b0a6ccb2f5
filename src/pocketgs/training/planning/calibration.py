"""Calibration: the speed of this machine, from parts of a sweep and a few training steps on synthetic images."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.geometry.camera import Camera
from pocketgs.prior.depth.cpu.stereo import CpuStereo
from pocketgs.prior.depth.depth_range import DepthRange
from pocketgs.prior.depth.room import with_room
from pocketgs.prior.depth.stereo import Stereo, StereoExtent
from pocketgs.prior.depth.sweep import SweepSettings
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import Engine
from pocketgs.splat.settings import LearningRates, StepSettings
from pocketgs.training.options import SizedOptions

WIDTH, HEIGHT, FOCAL = 320, 240, 320.0
GAUSSIANS = 30_000
REPEATS = 3
DISTANCE = 4.0
BASELINE = 0.3
HYPOTHESES = 128

SWEEP_SECONDS, STEP_SECONDS = 0.068, 0.0095
"""Seconds of one sweep and of one step on the machine that `time_model` was measured on."""


@dataclass(frozen=True)
class Speed:
    """Duration of work relative to the machine that the time model was measured on.

    Attributes:
        prior: on the CPU.
        sweeps: of keyframes, on the device of the engine; where it has too little memory, the CPU's is theirs.
        training: of the engine.
    """

    prior: float
    sweeps: float
    training: float


def times_prior(engine: Engine, options: SizedOptions) -> bool:
    """Whether calibration sweeps on the CPU: before depth maps, and beside a GPU.

    A GPU's speed says nothing about the CPU's, which does the rest of the work.
    """
    return options.prior == "dense" or engine.name != "cpu"


def measure_speed(engine: Engine, stereo: Stereo, threads: int, with_prior: bool) -> Speed:
    """Measure the speed of this machine, within a few tenths of a second once kernels are compiled.

    Args:
        engine: an engine whose scene may be overwritten.
        stereo: computes depth maps.
        threads: CPU threads.
        with_prior: whether to time the prior too, see `times_prior`; otherwise the engine's speed is used for both.
    """
    numba.set_num_threads(threads)
    rng = np.random.default_rng(0)
    frames = [_frame(rng, index) for index in range(3)]
    training = _step_seconds(engine, frames[0], rng) / STEP_SECONDS
    if not with_prior:
        return Speed(training, training, training)
    prior = _sweep_seconds(CpuStereo(), frames) / SWEEP_SECONDS
    stereo, _ = with_room(stereo, StereoExtent.of([(WIDTH, HEIGHT)], len(frames) - 1, len(frames)))
    if stereo.name == "cpu":
        return Speed(prior, prior, training)
    try:
        return Speed(prior, _sweep_seconds(stereo, frames) / SWEEP_SECONDS, training)
    finally:
        stereo.release()


def _frame(rng: np.random.Generator, index: int) -> Frame:
    pose = np.eye(4)
    pose[0, 3] = index * BASELINE
    camera = Camera(WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, pose)
    return Frame(str(index), camera, rng.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8))


def _sweep_seconds(stereo: Stereo, frames: list[Frame]) -> float:
    """Seconds of one sweep with two source views."""
    search = DepthRange(DISTANCE / 2, DISTANCE * 2, HYPOTHESES)
    return _least_seconds(lambda: stereo.sweep(frames[0], frames[1:], search, SweepSettings()))


def _least_seconds(work: Callable[[], object]) -> float:
    """Minimum time of several repeats: the first loads kernels, and others may be disturbed."""
    seconds = []
    for _ in range(REPEATS):
        started = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - started)
    return min(seconds)


def _step_seconds(engine: Engine, frame: Frame, rng: np.random.Generator) -> float:
    """Seconds of one step on Gaussians that cover the image once, like those of a dense cloud."""
    across, down = WIDTH / FOCAL * DISTANCE, HEIGHT / FOCAL * DISTANCE
    means = rng.uniform(-0.5, 0.5, (GAUSSIANS, 3)) * (across, down, 0.2) + (0, 0, DISTANCE)
    size = np.log(np.sqrt(across * down / GAUSSIANS))
    scene = Gaussians(
        means,
        np.full((GAUSSIANS, 3), size),
        np.tile([1.0, 0, 0, 0], (GAUSSIANS, 1)),
        np.zeros(GAUSSIANS),
        rng.normal(size=(GAUSSIANS, 1, 3)),
    )
    settings = StepSettings(LearningRates(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    engine.prepare()
    engine.set_views([frame])
    engine.upload(scene)

    def step() -> None:
        engine.step(0, settings)
        engine.loss()

    return _least_seconds(step)
