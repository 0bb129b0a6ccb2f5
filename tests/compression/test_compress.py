"""Compression of a small scene: bounds, files that equal the measured scenes, and interruptions."""

from __future__ import annotations

import signal
from collections.abc import Callable
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from pocketgs.capture import Capture
from pocketgs.cli.compression_table import figures_table
from pocketgs.compression import candidates
from pocketgs.compression.bound import QualityBound
from pocketgs.compression.compress import GENTLE_RATE, _suitable_rate, compress
from pocketgs.compression.figures import figures_of
from pocketgs.compression.fine_tuning import RATE, FineTuner
from pocketgs.compression.judgement import Judge
from pocketgs.compression.options import CompressionOptions
from pocketgs.compression.pruning import Pruner, Pruning
from pocketgs.compression.searches import GRIDS
from pocketgs.compression.spz_file import as_spz, rounded_as_spz
from pocketgs.compression.timekeeper import Timekeeper
from pocketgs.compression.views import Views, cameras_around, photographed, rendered
from pocketgs.errors import PocketGSError
from pocketgs.scene.edits import scaled
from pocketgs.scene.formats.pgs import encode
from pocketgs.scene.formats.pgs_coding import FINE, Coding
from pocketgs.scene.formats.pgs_rounding import rounded as rounded_scene
from pocketgs.scene.formats.spz_range import suitable_factor
from pocketgs.scene.gaussians import PARAMETERS, Gaussians
from pocketgs.scene.warning import SceneWarning
from pocketgs.splat.engine import Engine
from pocketgs.splat.rasterizer import Rasterizer
from pocketgs.system.interrupt import Interrupt

pytestmark = pytest.mark.usefixtures("_few_steps")


def in_order(scene: Gaussians) -> np.ndarray:
    """All numbers of a scene, one row per Gaussian, sorted."""
    rows = np.concatenate([getattr(scene, name).reshape(len(scene), -1) for name in PARAMETERS], axis=1)
    return rows[np.lexsort(rows.T)]


@pytest.mark.parametrize("prune", get_args(Pruning))
def test_photographs(
    scene: Gaussians, views: Views, engine: Engine, prune: Pruning, monkeypatch: pytest.MonkeyPatch
) -> None:
    counts: list[tuple[int, int]] = []
    judged: list[np.ndarray] = []
    options = CompressionOptions(prune=prune)
    keep = candidates.Workshop._keep

    def watched(workshop: candidates.Workshop, scene: Gaussians, coding: Coding) -> candidates.Candidate:
        judged.append(in_order(scene))
        return keep(workshop, scene, coding)

    monkeypatch.setattr(candidates.Workshop, "_keep", watched)
    found = compress(scene, views, engine, options, on_count=lambda done, of: counts.append((done, of)))
    assert found.within_bound
    assert len(found.chosen.scene) < len(scene)
    assert all(done <= of for done, of in counts)
    for candidate, expected in zip(found.candidates, judged, strict=True):
        np.testing.assert_array_equal(in_order(candidate.scene), expected, "a file holds what was judged")
    original = figures_of("original", scene, 1, engine, views)
    compressed = figures_of("compressed", found.chosen.scene, len(found.chosen.contents), engine, views)
    spz = as_spz(scene)
    assert spz is not None
    assert original.psnr is not None
    assert compressed.psnr is not None
    assert compressed.psnr >= original.psnr - 0.6, "expected 0.3 dB, measured on a single view of 96 x 72"
    assert len(found.chosen.contents) < 0.5 * spz.bytes


@pytest.mark.parametrize("known", [True, False])
def test_without_photographs_nothing_is_worse_than_spz(
    scene: Gaussians, views: Views, engine: Engine, known: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pocketgs.compression.views.SIDE", 96)
    cameras = {frame.name: frame.camera for frame in [*views.train, *views.reported]}
    own = rendered(scene, cameras if known else cameras_around(scene), engine, views.background)
    found = compress(scene, own, engine)
    spz = as_spz(scene)
    assert spz is not None
    rounded = figures_of(".spz", spz.scene, spz.bytes, engine, own)
    compressed = figures_of(".pgs", found.chosen.scene, len(found.chosen.contents), engine, own)
    assert rounded.psnr is not None
    assert compressed.psnr is not None
    assert compressed.psnr >= rounded.psnr
    assert compressed.megabytes < rounded.megabytes


@pytest.mark.parametrize(
    ("fits", "seconds", "rate"), [(False, None, RATE), (True, None, GENTLE_RATE), (True, 0.0, RATE)]
)
def test_rates_are_gentle_where_usual_ones_do_harm(
    scene: Gaussians, views: Views, engine: Engine, fits: bool, seconds: float | None, rate: float
) -> None:
    """A scene that has hardly been trained gains, one that fits its views perfectly loses; trying takes time."""
    if fits:
        cameras = {frame.name: frame.camera for frame in views.train}
        views = replace(rendered(scene, cameras, engine, views.background), photographs=True)
    timekeeper = Timekeeper(lambda done, of: None, Interrupt(), seconds)
    tuner = FineTuner(engine, views.train, views.background, scene, 0, timekeeper.step)
    pruner = Pruner(tuner, [frame.camera for frame in views.train], "contribution", Rasterizer("cpu"))
    judge = Judge.of(scene, engine, views)
    workshop = candidates.Workshop(tuner, pruner, judge, timekeeper, FINE, lambda candidate: True)
    assert _suitable_rate(scene, workshop) == rate


def test_size_and_seed(scene: Gaussians, views: Views, engine: Engine) -> None:
    found, again = (compress(scene, views, engine, CompressionOptions(size=0.006)) for _ in range(2))
    assert 0.004 < found.chosen.megabytes <= 0.006
    assert found.chosen.psnr == max(each.psnr for each in found.candidates if each.megabytes <= 0.006)
    assert again.chosen.contents == found.chosen.contents


def test_a_size_that_the_whole_scene_fits(scene: Gaussians, views: Views, engine: Engine) -> None:
    """The finely rounded whole scene is closest to the original."""
    found = compress(scene, views, engine, CompressionOptions(size=1.0), seconds=0.01)
    assert found.chosen.psnr >= max(each.psnr for each in found.candidates)
    assert found.chosen.psnr > found.original_psnr - 0.05
    np.testing.assert_array_equal(in_order(found.chosen.scene), in_order(rounded_scene(scene, FINE)))


def test_grids_are_tried_once(scene: Gaussians, views: Views, engine: Engine, monkeypatch: pytest.MonkeyPatch) -> None:
    """Even if no candidate is within the bound."""
    monkeypatch.setattr("pocketgs.compression.searches.GRIDS", 1)
    cameras = {frame.name: frame.camera for frame in views.train[:2]}
    own = rendered(scene, cameras, engine, views.background)
    monkeypatch.setattr("pocketgs.compression.compress._bound", lambda *_: QualityBound(99.0))
    found = compress(scene, own, engine, seconds=0.01)
    assert not found.within_bound
    assert sum(len(each.scene) == len(scene) for each in found.candidates) <= 2, "rounded finely, and as all candidates"


def test_the_unit_of_length_does_not_matter(scene: Gaussians, engine: Engine, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor that a .spz cuts sizes of such units, whose quality is the bound without a capture."""
    monkeypatch.setattr("pocketgs.compression.views.SIDE", 96)
    counts = []
    for units in (1.0, 1e3, 1e-4):
        each = scaled(scene, units)
        found = compress(each, rendered(each, cameras_around(each), engine, (0.0, 0.0, 0.0)), engine)
        assert found.within_bound
        counts.append(found.chosen.count)
    assert counts[1:] == pytest.approx([counts[0]] * 2, rel=0.15)


def test_a_large_gaussian_of_the_background_is_not_cut_for_the_bound(scene: Gaussians) -> None:
    """In a unit of length that suits most Gaussians it would be."""
    sizes = scene.log_scales - np.median(scene.log_scales.max(axis=1)) - 4.3
    sizes[0] = 5.5
    scene = replace(scene, log_scales=sizes.astype(np.float32))
    assert suitable_factor(scene) == 10.0
    assert rounded_as_spz(scene).log_scales.max() == pytest.approx(5.5, abs=0.1)


@pytest.mark.parametrize("distance", [1e7, 1e30])
def test_a_scene_too_large_for_spz(scene: Gaussians, views: Views, engine: Engine, distance: float) -> None:
    """In any unit of length: centres would be coarse, or too large."""
    means = scene.means.copy()
    means[0] = distance
    far = replace(scene, means=means)
    assert as_spz(far) is None
    own = rendered(far, {frame.name: frame.camera for frame in views.train}, engine, views.background)
    with pytest.raises(PocketGSError, match=r"more than a \.spz can hold.* expected the capture, or --size"):
        compress(far, own, engine)


@pytest.mark.parametrize(("seconds", "is_written"), [(0.01, False), (5.0, True), (None, True)])
def test_a_spz_is_written_for_the_table_if_there_is_time(
    scene: Gaussians, views: Views, engine: Engine, seconds: float | None, is_written: bool
) -> None:
    found = compress(scene, views, engine, CompressionOptions(quality=3.0), seconds=seconds)
    assert found.compares_spz == is_written
    _, spz, *_ = figures_table(scene, 1, found, engine, views)
    assert (spz.name, spz.megabytes is not None) == (".spz", is_written)


def test_a_size_that_all_gaussians_with_a_codebook_do_not_fill(scene: Gaussians, views: Views, engine: Engine) -> None:
    """Some of them on fine grids do."""
    sh = scene.sh.copy()
    sh[:, 1:] += np.random.default_rng(1).normal(0.0, 0.3, sh[:, 1:].shape).astype(np.float32)
    shiny = replace(scene, sh=sh)
    size = 0.9 * len(encode(shiny, FINE)) / 1e6
    found = compress(shiny, views, engine, CompressionOptions(size=size))
    assert 0.8 * size < found.chosen.megabytes <= size


def test_no_file_is_that_small(scene: Gaussians, views: Views, engine: Engine) -> None:
    with pytest.raises(PocketGSError, match=r"the smallest file has 0\.\d{6} MB, expected --size of at least some 0\."):
        compress(scene, views, engine, CompressionOptions(size=1e-5))


def test_a_time_budget_ends_the_search(scene: Gaussians, views: Views, engine: Engine) -> None:
    steps: list[int] = []
    found = compress(scene, views, engine, seconds=0.01, on_count=lambda done, of: steps.append(done))
    assert found.chosen.contents
    assert not steps, "time was up before the first of them"
    assert found.within_bound
    assert len(found.chosen.scene) == len(scene)


def test_no_search_on_fine_grids_after_time_is_up(
    scene: Gaussians, views: Views, engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pocketgs.compression.compress._bound", lambda *_: QualityBound(99.0))
    found = compress(scene, views, engine, seconds=0.01)
    assert len(found.candidates) == 1 + GRIDS, "one with a codebook, and the whole scene on finer and finer grids"


def pressing_ctrl_c(step: int) -> Callable[[int, int], None]:
    """Counts steps, and presses Ctrl-C at a given one."""

    def count(done: int, of: int) -> None:
        if done == step:
            signal.raise_signal(signal.SIGINT)

    return count


def test_ctrl_c_before_there_is_a_file(scene: Gaussians, views: Views, engine: Engine) -> None:
    with pytest.raises(KeyboardInterrupt):
        compress(scene, views, engine, on_count=pressing_ctrl_c(3))


def test_ctrl_c_keeps_the_best_file_so_far(
    scene: Gaussians, views: Views, engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep = candidates.Workshop._keep

    def and_press_ctrl_c(workshop: candidates.Workshop, scene: Gaussians, coding: Coding) -> candidates.Candidate:
        found = keep(workshop, scene, coding)
        signal.raise_signal(signal.SIGINT)
        return found

    monkeypatch.setattr(candidates.Workshop, "_keep", and_press_ctrl_c)
    found = compress(scene, views, engine, CompressionOptions(quality=10.0))
    assert found.interrupted
    assert found.within_bound
    assert len(found.candidates) == 1


def test_training_that_diverges_keeps_the_best_file_so_far(
    scene: Gaussians, views: Views, engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    make = candidates.Workshop.make

    def and_diverge(workshop: candidates.Workshop, count: int) -> candidates.Candidate:
        tune = workshop.tuner.tune
        if workshop.candidates:
            workshop.tuner.tune = lambda *args, **options: with_nan(tune(*args, **options))  # type: ignore[method-assign]
        return make(workshop, count)

    def with_nan(tuned: Gaussians) -> Gaussians:
        tuned.means[0] = np.nan
        return tuned

    monkeypatch.setattr(candidates.Workshop, "make", and_diverge)
    with pytest.warns(SceneWarning, match="the search ended early: .*NaN"):
        found = compress(scene, views, engine, CompressionOptions(quality=10.0))
    assert found.within_bound
    assert len(found.candidates) == 1


def test_what_cannot_be_drawn_is_left_out(scene: Gaussians, views: Views, engine: Engine) -> None:
    broken = scene.select(np.arange(len(scene)))
    broken.means[::7] = np.nan
    found = compress(broken, views, engine, CompressionOptions(size=0.004))
    assert np.isfinite(found.chosen.scene.means).all()
    broken.means[:] = np.inf
    with pytest.raises(PocketGSError, match="found no Gaussian without NaN or infinity"):
        compress(broken, views, engine)


def test_a_capture_without_training_views(small_capture: Capture) -> None:
    with pytest.raises(PocketGSError, match="no training view"):
        photographed(replace(small_capture, train=[]))
