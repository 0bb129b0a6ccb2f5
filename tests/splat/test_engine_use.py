"""Engines that are used out of order, or again."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from pocketgs import Gaussians, PocketGSError
from pocketgs.splat.choose_engine import create_engine
from pocketgs.splat.engine import Engine, EngineOptions
from pocketgs.splat.settings import LossSettings, StepSettings
from splat.training_step import BACKGROUND, RATES, begin, camera_in_front, photograph

MakeGaussians = Callable[..., Gaussians]
STEP = StepSettings(RATES, LossSettings(), background=BACKGROUND)


@pytest.fixture(params=["cpu", "webgpu"])
def engine(request: pytest.FixtureRequest) -> Engine:
    if request.param == "webgpu":
        request.getfixturevalue("adapter")
    return create_engine(EngineOptions(request.param))


def test_a_new_engine_holds_nothing(engine: Engine) -> None:
    camera = camera_in_front(20, 10, 20.0)
    assert engine.count == len(engine.download()) == 0
    assert engine.render(camera).alpha.max() == 0.0
    with pytest.raises(PocketGSError, match="there are no views, expected a call of set_views before"):
        engine.step(0, STEP)
    engine.set_views([photograph(camera)])
    engine.step(0, STEP)
    assert engine.loss() > 0.0


@pytest.mark.parametrize("view", [2, -1, 0.5])
def test_views_that_are_not_there_are_refused(engine: Engine, make_gaussians: MakeGaussians, view: int) -> None:
    begin(engine, make_gaussians(count=3), 2 * [photograph(camera_in_front(20, 10, 20.0))])
    with pytest.raises(PocketGSError, match=f"found view {view}, expected 0 to 1: set_views gives 2"):
        engine.step(view, STEP)


def test_an_upload_restarts_the_loss(engine: Engine, make_gaussians: MakeGaussians) -> None:
    frames = [photograph(camera_in_front(40, 30, 40.0))]
    begin(engine, make_gaussians(count=30, seed=1), frames)
    assert math.isnan(engine.loss())
    for _ in range(3):
        engine.step(0, STEP)
    engine.upload(make_gaussians(count=30, seed=2))
    assert math.isnan(engine.loss())
    engine.step(0, STEP)
    assert engine.loss(4) == engine.loss(1) > 0.0


@pytest.mark.usefixtures("adapter")
def test_what_was_lost_when_memory_ran_out_is_named(
    monkeypatch: pytest.MonkeyPatch, make_gaussians: MakeGaussians
) -> None:
    import wgpu

    engine = create_engine(EngineOptions("webgpu"))
    engine.upload(make_gaussians(count=30))
    camera, larger = camera_in_front(40, 30, 40.0), camera_in_front(200, 150, 200.0)
    expected = engine.render(camera).image
    create_buffer = engine.executor.device.create_buffer  # type: ignore[attr-defined]

    def scarce(**named: object) -> object:
        if named["label"] == "image":
            raise wgpu.GPUOutOfMemoryError("no memory")
        return create_buffer(**named)

    with monkeypatch.context() as patch:
        patch.setattr(engine.executor.device, "create_buffer", scarce)  # type: ignore[attr-defined]
        with pytest.raises(PocketGSError, match="the GPU is out of memory"):
            engine.render(larger)
    with pytest.raises(PocketGSError, match="'image' was lost when the GPU ran out of memory"):
        engine.render(camera)
    engine.render(larger)
    np.testing.assert_array_equal(engine.render(camera).image, expected)
