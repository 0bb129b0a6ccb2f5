"""Rounding with training in between: what a file holds, and what training the codebook of harmonics is worth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pocketgs.compression import rounding
from pocketgs.compression.fine_tuning import FineTuner
from pocketgs.compression.judgement import errors
from pocketgs.compression.rounding import rounded_in_turn
from pocketgs.compression.views import Views
from pocketgs.scene.edits import with_sh_degree
from pocketgs.scene.formats.pgs import decode, encode
from pocketgs.scene.formats.pgs_coding import DEFAULT, FINE, Coding
from pocketgs.scene.formats.pgs_rounding import MIN_ENTRIES
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import Engine

STEPS = 15


@pytest.fixture(scope="module")
def shiny(scene: Gaussians) -> Gaussians:
    """The scene with harmonics that differ from one Gaussian to the next."""
    sh = scene.sh.copy()
    sh[:, 1:] += np.random.default_rng(1).normal(0.0, 0.15, sh[:, 1:].shape).astype(np.float32)
    return replace(scene, sh=sh)


def in_turn(scene: Gaussians, views: Views, engine: Engine, coding: Coding) -> Gaussians:
    tuner = FineTuner(engine, views.train, views.background, scene, seed=0)
    return rounded_in_turn(scene, tuner, coding, STEPS, np.ones(len(scene)))


def distinct_harmonics(scene: Gaussians) -> int:
    return len(np.unique(scene.sh[:, 1:].reshape(len(scene), -1), axis=0))


def test_the_codebook_is_trained(
    shiny: Gaussians, views: Views, engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    trained = in_turn(shiny, views, engine, DEFAULT)
    monkeypatch.setattr(rounding, "BOOK_ROUNDS", 0)
    fixed = in_turn(shiny, views, engine, DEFAULT)
    assert 1 < distinct_harmonics(trained) <= MIN_ENTRIES
    found, expected = (errors(engine, scene, views, views.train).mean() for scene in (trained, fixed))
    assert found < 0.97 * expected


@pytest.mark.parametrize("coding", [DEFAULT, FINE])
@pytest.mark.parametrize("degree", [0, 1])
def test_a_file_holds_it_exactly(shiny: Gaussians, views: Views, engine: Engine, coding: Coding, degree: int) -> None:
    found = in_turn(with_sh_degree(shiny, degree), views, engine, coding)
    stored = decode(encode(found, coding))
    for name in ("means", "sh"):
        expected, read = (np.unique(getattr(each, name).reshape(len(found), -1), axis=0) for each in (found, stored))
        np.testing.assert_array_equal(read, expected)
