"""Masks that are set during a run apply from the next step on, on every engine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pocketgs.errors import PocketGSError
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.engine import Engine, EngineOptions
from pocketgs.splat.settings import LossSettings, StepSettings
from splat.training_step import BACKGROUND, RATES, assert_identical, begin, camera_in_front, photograph
from splat.webgpu.variants import shared_engine

MakeGaussians = Callable[..., Gaussians]
STEP = StepSettings(RATES, LossSettings(), background=BACKGROUND)


@pytest.fixture(params=["cpu", "webgpu"])
def engine(request: pytest.FixtureRequest) -> Engine:
    if request.param == "cpu":
        return CpuEngine(2)
    request.getfixturevalue("adapter")
    return shared_engine(EngineOptions("webgpu"))


def stepped(engine: Engine, steps: int) -> Gaussians:
    for step in range(steps):
        engine.step(step % 2, STEP)
    return engine.download()


def test_masks_count_as_if_they_had_been_there(engine: Engine, make_gaussians: MakeGaussians) -> None:
    camera = camera_in_front(40, 30, 40.0)
    masked = [photograph(camera, masked=True, seed=seed) for seed in (1, 2)]
    scene = make_gaussians(30, 1)
    expected = stepped(begin(engine, scene, masked), 4)
    bare = [replace(frame, mask=None) for frame in masked]
    begin(engine, scene, bare).set_masks([frame.mask for frame in masked])
    assert_identical(stepped(engine, 4), expected)
    begin(engine, scene, masked).set_masks([None, None])
    found = stepped(engine, 4)
    assert_identical(found, stepped(begin(engine, scene, bare), 4))
    assert (found.means != expected.means).any()


def test_a_mask_that_is_changed_in_place_counts(engine: Engine, make_gaussians: MakeGaussians) -> None:
    frame = photograph(camera_in_front(40, 30, 40.0))
    begin(engine, make_gaussians(30, 1), [frame])
    mask = np.ones((30, 40), np.bool_)
    engine.set_masks([mask])
    engine.step(0, STEP)
    assert engine.loss() > 0.01
    mask[:] = False
    engine.set_masks([mask])
    engine.step(0, STEP)
    assert engine.loss() < 1e-4


def test_masks_of_other_photographs_are_refused(engine: Engine, make_gaussians: MakeGaussians) -> None:
    begin(engine, make_gaussians(5, 0), [photograph(camera_in_front(40, 30, 40.0))])
    with pytest.raises(PocketGSError, match="masks: found 2, expected one for each of 1 photographs"):
        engine.set_masks([None, None])
    with pytest.raises(
        PocketGSError, match=r"mask 0: found bool of shape \(40, 30\), expected bool of shape \(30, 40\)"
    ):
        engine.set_masks([np.ones((40, 30), np.bool_)])
