"""The WebGPU engine leaves alone what a view does not see, as the reference does."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import EngineOptions
from splat.seen_only import (
    assert_steps_agree_with_the_reference,
    assert_what_is_not_seen_drifts_on_otherwise,
    assert_what_is_not_seen_stays,
)
from splat.webgpu.variants import EXACT, every_variant, shared_engine

pytestmark = pytest.mark.usefixtures("adapter")

MakeGaussians = Callable[..., Gaussians]


@every_variant
def test_what_is_not_seen_stays(make_gaussians: MakeGaussians, options: EngineOptions) -> None:
    assert_what_is_not_seen_stays(shared_engine(options), make_gaussians)


def test_what_is_not_seen_drifts_on_otherwise(make_gaussians: MakeGaussians) -> None:
    assert_what_is_not_seen_drifts_on_otherwise(shared_engine(EngineOptions("webgpu")), make_gaussians)


@every_variant
def test_steps_agree_with_the_reference(make_gaussians: MakeGaussians, options: EngineOptions) -> None:
    exact = EXACT[options.precision]
    assert_steps_agree_with_the_reference(shared_engine(options), make_gaussians, max(5e-3, 5 * exact.gradient))
