"""Dropout in a training step: checks shared by the tests of all engines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import Engine
from pocketgs.splat.reference.scene import Scene
from pocketgs.splat.settings import AdamSettings, Dropout, LossSettings, StepSettings
from splat.seen_only import rows_that_differ
from splat.training_step import BACKGROUND, RATES, begin, camera_in_front, columns, photograph, reference_step

COUNT = 200
SETTINGS = StepSettings(RATES, LossSettings(), AdamSettings(seen_only=True), BACKGROUND)


def left_out(dropout: Dropout, count: int) -> np.ndarray:
    """(count,) bool: which Gaussians a step leaves out, in Python's integers."""

    def hashed(word: int) -> int:
        state = (word * 747796405 + 2891336453) % 2**32
        mixed = ((state >> ((state >> 28) + 4)) ^ state) * 277803737 % 2**32
        return (mixed >> 22) ^ mixed

    return np.array([hashed(hashed(dropout.seed) ^ row) < dropout.share * 2**32 for row in range(count)])


def assert_a_step_leaves_out_a_share(engine: Engine, make_gaussians: Callable[..., Gaussians]) -> None:
    """A step is the reference's of the other Gaussians; those left out stay, and each step chooses anew."""
    gaussians = make_gaussians(count=COUNT, sh_degree=1, size=0.15)
    gaussians.opacity_logits += 2.0
    frames = [photograph(camera_in_front(48, 40, 40.0))]
    begin(engine, gaussians, frames)
    choices = []
    for seed in (1, 2**32 - 1):
        settings = replace(SETTINGS, dropout=Dropout(0.3, seed))
        dropped, before = left_out(settings.dropout, COUNT), engine.download()
        engine.step(0, settings)
        loss, gradient, _ = reference_step(Scene.of(before.select(~dropped)), frames[0], settings)
        np.testing.assert_allclose(engine.loss(), loss, rtol=1e-3)
        changed, seen = rows_that_differ(engine.download(), before), columns(gradient).any(axis=1)
        assert not changed[dropped].any()
        assert seen.mean() > 0.8
        np.testing.assert_array_equal(changed[~dropped], seen)
        choices.append(dropped)
    assert all(0.2 < dropped.mean() < 0.4 for dropped in choices)
    assert 0.3 < np.mean(choices[0] != choices[1]) < 0.55


def assert_a_rendering_shows_all(engine: Engine, make_gaussians: Callable[..., Gaussians]) -> None:
    """Dropout belongs to a step: images after it, and steps without it, are of all Gaussians."""
    gaussians, camera = make_gaussians(count=COUNT, sh_degree=1, size=0.15), camera_in_front(48, 40, 40.0)
    still = replace(SETTINGS, rates=replace(RATES, **dict.fromkeys(vars(RATES), 0.0)))
    begin(engine, gaussians, [photograph(camera)])
    expected = engine.render(camera).image
    losses = []
    for dropout in (None, Dropout(0.0, 3), Dropout(0.5, 3), None):
        engine.step(0, replace(still, dropout=dropout))
        losses.append(engine.loss())
        # A step of length 0 still normalises rotations.
        np.testing.assert_allclose(engine.render(camera).image, expected, atol=1e-5)
    assert losses[1:4:2] == pytest.approx([losses[0]] * 2, rel=1e-5)
    assert losses[2] != pytest.approx(losses[0], rel=1e-3)
