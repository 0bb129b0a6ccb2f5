"""Learned masks find the Gaussians that a scene can do without."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pocketgs.capture import Capture
from pocketgs.compression.fine_tuning import FineTuner
from pocketgs.compression.judgement import Judge
from pocketgs.compression.masks import prune_by_masks
from pocketgs.compression.pruning import Pruner
from pocketgs.compression.views import Views, photographed
from pocketgs.errors import PocketGSError
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import Engine
from pocketgs.splat.rasterizer import Rasterizer

STEPS = 80


def tuner_of(scene: Gaussians, views: Views, engine: Engine) -> FineTuner:
    return FineTuner(engine, views.train, views.background, scene, 0)


def test_masks_cost_less_than_contributions(scene: Gaussians, views: Views, engine: Engine) -> None:
    """At equal count, after equally many steps of training."""
    judge, count = Judge.of(scene, engine, views), len(scene) // 4
    tuner = tuner_of(scene, views, engine)
    by_masks = tuner.tune(prune_by_masks(tuner, Rasterizer(), scene, count, STEPS), STEPS)
    tuner = tuner_of(scene, views, engine)
    pruner = Pruner(tuner, [frame.camera for frame in views.train], "contribution", Rasterizer())
    by_contributions = tuner.tune(pruner.down_to(scene, count), 2 * STEPS)
    assert len(by_masks) == len(by_contributions) == count
    assert judge.psnr(by_masks) > judge.psnr(by_contributions)


def test_what_nobody_sees_goes_first(scene: Gaussians, views: Views, engine: Engine) -> None:
    hidden = np.arange(0, len(scene), 5)
    means = scene.means.copy()
    means[hidden] += 1000.0
    moved = replace(scene, means=means)
    kept = prune_by_masks(tuner_of(scene, views, engine), Rasterizer(), moved, len(scene) - len(hidden), 20)
    assert np.abs(kept.means).max() < 500.0


def test_the_same_masks_every_time(scene: Gaussians, views: Views, engine: Engine) -> None:
    found = [prune_by_masks(tuner_of(scene, views, engine), Rasterizer(), scene, 100, 20) for _ in range(2)]
    np.testing.assert_array_equal(found[0].means, found[1].means)
    np.testing.assert_array_equal(found[0].sh, found[1].sh)


def test_certain_opacities_stay_finite(scene: Gaussians, views: Views, engine: Engine) -> None:
    logits = scene.opacity_logits.copy()
    logits[::7], logits[1::7] = np.inf, -np.inf
    sure = replace(scene, opacity_logits=logits)
    kept = prune_by_masks(tuner_of(scene, views, engine), Rasterizer(), sure, len(scene) // 2, 20)
    assert np.isfinite(kept.opacity_logits).all()
    assert (kept.opacity_logits > 10).any()


def test_too_few_steps_to_show_all_views_train_no_masks(scene: Gaussians, views: Views, engine: Engine) -> None:
    cameras = [frame.camera for frame in views.train]
    by_masks, by_contributions = (
        Pruner(tuner_of(scene, views, engine), cameras, method, Rasterizer()) for method in ("masks", "contribution")
    )
    found = by_masks.at_once(scene, 500, len(cameras) - 1)
    np.testing.assert_array_equal(found.means, by_contributions.down_to(scene, 500).means)
    assert not by_contributions.trains_masks(1000)


def test_photographs_that_are_masked_completely_take_no_part(small_capture: Capture) -> None:
    nothing = np.zeros(small_capture.train[0].image.shape[:2], np.bool_)
    train = [replace(frame, mask=nothing) if i == 2 else frame for i, frame in enumerate(small_capture.train)]
    found = photographed(replace(small_capture, train=train)).train
    assert [frame.name for frame in found] == [frame.name for i, frame in enumerate(train) if i != 2]
    with pytest.raises(PocketGSError, match="not masked completely"):
        photographed(replace(small_capture, train=[train[2]]))
