"""The WebGPU engine leaves out the same Gaussians as the CPU engine."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import EngineOptions
from splat.dropout import assert_a_rendering_shows_all, assert_a_step_leaves_out_a_share
from splat.webgpu.variants import shared_engine

MakeGaussians = Callable[..., Gaussians]
pytestmark = pytest.mark.usefixtures("adapter")


def test_a_step_leaves_out_a_share(make_gaussians: MakeGaussians) -> None:
    assert_a_step_leaves_out_a_share(shared_engine(EngineOptions(engine="webgpu")), make_gaussians)


def test_a_rendering_shows_all(make_gaussians: MakeGaussians) -> None:
    assert_a_rendering_shows_all(shared_engine(EngineOptions(engine="webgpu")), make_gaussians)
