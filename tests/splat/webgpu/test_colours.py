"""Colour transforms on the GPU: against the reference and the CPU engine, and the same bits after a break."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.engine import EngineOptions
from pocketgs.splat.settings import ColourSettings
from splat.coloured_steps import COLOURED, colours_after_a_checked_step, frames_of
from splat.training_step import assert_identical, begin, photograph
from splat.webgpu.variants import shared_engine

pytestmark = pytest.mark.usefixtures("adapter")

MakeGaussians = Callable[..., Gaussians]
OPTIONS = EngineOptions("webgpu")


@pytest.mark.parametrize("masked", [False, True])
def test_a_step_agrees_with_the_reference(camera: Camera, make_gaussians: MakeGaussians, masked: bool) -> None:
    gaussians = make_gaussians(count=60, sh_degree=1, size=0.15)
    colours_after_a_checked_step(shared_engine(OPTIONS), gaussians, photograph(camera, masked))


def test_errors_are_those_before_the_update_of_colours(camera: Camera, make_gaussians: MakeGaussians) -> None:
    gaussians, frames = make_gaussians(count=60, sh_degree=0, size=0.15), frames_of(camera)
    step = replace(COLOURED, errors=True, colours=ColourSettings(rate=0.3))
    found = []
    for engine in (shared_engine(OPTIONS), CpuEngine(1)):
        begin(engine, gaussians, frames).step(0, step)
        found.append(engine.statistics().errors)
    assert found[1].max() > 0.1
    np.testing.assert_allclose(found[0], found[1], atol=1e-3 * found[1].max())


def test_steps_end_as_on_the_cpu_and_with_the_same_bits_after_a_break(
    camera: Camera, make_gaussians: MakeGaussians
) -> None:
    gaussians, frames = make_gaussians(count=60, sh_degree=0, size=0.15), frames_of(camera)
    engine, cpu = (begin(one, gaussians, frames) for one in (shared_engine(OPTIONS), CpuEngine(1)))
    for step in range(6):
        if step == 3:
            middle, state = engine.download(), engine.optimiser_state()
        engine.step(step % 3, COLOURED)
        cpu.step(step % 3, COLOURED)
    whole, measured, expected = engine.download(), engine.optimiser_state().colours, cpu.optimiser_state().colours
    assert measured is not None
    assert expected is not None
    np.testing.assert_allclose(measured, expected, atol=2e-3)
    engine.set_views(frames)
    assert engine.optimiser_state().colours is None
    engine.upload(middle, state)
    for step in range(3, 6):
        engine.step(step % 3, COLOURED)
    assert_identical(engine.download(), whole)
    colours = engine.optimiser_state().colours
    assert colours is not None
    assert colours.tobytes() == measured.tobytes()
