"""What the WebGPU engine promises whatever it is fed: the same bits every time, finite images, room where it is needed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pocketgs.camera import Camera
from pocketgs.capture.capture import Frame
from pocketgs.gaussians import PARAMETERS, Gaussians
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.engine import Engine, EngineOptions
from pocketgs.splat.settings import LossSettings, StepSettings
from pocketgs.splat.webgpu.engine import WebGpuEngine
from splat.training_step import BACKGROUND, RATES, assert_identical, camera_in_front, photograph
from splat.webgpu.variants import every_ordered_variant, every_variant, shared_engine

pytestmark = pytest.mark.usefixtures("adapter")

STEP = StepSettings(RATES, LossSettings(scale_weight=1e-3), background=BACKGROUND)

MakeGaussians = Callable[..., Gaussians]


def begin[AnyEngine: Engine](engine: AnyEngine, gaussians: Gaussians, frames: Sequence[Frame]) -> AnyEngine:
    engine.set_views(frames)
    engine.upload(gaussians)
    return engine
