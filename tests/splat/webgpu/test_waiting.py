"""The host and the GPU: steps that wait for nothing, and a device that goes away."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pocketgs.errors import PocketGSError
from pocketgs.gpu import device as device_module
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.settings import LossSettings, StepSettings
from pocketgs.splat.webgpu import steps_ahead
from pocketgs.splat.webgpu.engine import WebGpuEngine
from splat.training_step import RATES, begin, camera_in_front, photograph

pytestmark = pytest.mark.usefixtures("adapter")

STEP = StepSettings(RATES, LossSettings())

MakeGaussians = Callable[..., Gaussians]


@pytest.fixture(autouse=True)
def _devices_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Other tests' engines go on with theirs."""
    monkeypatch.setattr(device_module, "_open", {})


@pytest.fixture(autouse=True)
def _few_steps_are_many(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(steps_ahead, "MAX_PENDING", 16)


@pytest.fixture
def engine(make_gaussians: MakeGaussians) -> WebGpuEngine:
    """One of its own, about to train."""
    return begin(WebGpuEngine(), make_gaussians(count=50), [photograph(camera_in_front(40, 30, 40.0))])


def test_steps_read_nothing_back(engine: WebGpuEngine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(steps_ahead, "SECONDS_AHEAD", float("inf"))
    engine.step(0, STEP)
    read: list[str] = []
    reading = engine.executor.read

    def listen(name: str, *arguments: Any) -> np.ndarray:
        read.append(name)
        return reading(name, *arguments)

    monkeypatch.setattr(engine.executor, "read", listen)
    for _ in range(steps_ahead.MAX_PENDING - 1):
        engine.step(0, STEP)
    assert read == []
    assert np.isfinite(engine.loss(steps_ahead.MAX_PENDING))
    assert engine.optimiser_state().steps == steps_ahead.MAX_PENDING


def test_the_host_runs_ahead_by_so_many_steps_only(engine: WebGpuEngine, monkeypatch: pytest.MonkeyPatch) -> None:
    for seconds, most in ((float("inf"), steps_ahead.MAX_PENDING), (0.0, 1)):
        monkeypatch.setattr(steps_ahead, "SECONDS_AHEAD", seconds)
        ahead = []
        for _ in range(2 * steps_ahead.MAX_PENDING + 2):
            engine.step(0, STEP)
            ahead.append(engine._ahead.next_number - 1 - engine._ahead.completed)
        assert max(ahead[steps_ahead.MAX_PENDING :]) == most - 1


def test_a_lost_device_ends_in_one_line(engine: WebGpuEngine) -> None:
    engine.step(0, STEP)
    engine.executor.device.destroy()
    for attempt in (engine.loss, engine.download, lambda: engine.step(0, STEP)):
        with pytest.raises(PocketGSError, match="the GPU was lost while working") as caught:
            attempt()
        assert "\n" not in str(caught.value)
    assert WebGpuEngine().executor.device is not engine.executor.device


def test_a_device_lost_while_memory_is_mapped_ends_in_one_line(
    engine: WebGpuEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: Any) -> None:
        raise RuntimeError("Could not map buffer: 'Unknown'.")  # wgpu's error, which has no type of its own

    engine.step(0, STEP)
    monkeypatch.setattr(type(engine.executor.device.queue), "read_buffer", fails)
    with pytest.raises(PocketGSError, match="the GPU was lost while working"):
        engine.download()
