"""Strategies: positions and numbers of new Gaussians, and resuming at any time."""

from __future__ import annotations

import signal
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pocketgs import Capture, Gaussians, PocketGSError
from pocketgs.geometry.quaternions import rotation_matrices
from pocketgs.prior.prior import PreparedCapture
from pocketgs.results.checkpoint import CHECKPOINT, MAX_GAUSSIANS, SHRINK, read_checkpoint, read_size, write_checkpoint
from pocketgs.scene.gaussians import PARAMETERS
from pocketgs.seeding.seeds import seed_balls
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.rows import RowChange, Statistics
from pocketgs.splat.settings import LossSettings
from pocketgs.splat.store import ParameterStore
from pocketgs.training import run_setup
from pocketgs.training.options import SizedOptions, TrainingOptions
from pocketgs.training.planning.effort import sized
from pocketgs.training.progress import Progress
from pocketgs.training.random_points import points_in_a_cube
from pocketgs.training.recipes import recipe_named
from pocketgs.training.result import Checkpoint
from pocketgs.training.run_setup import set_up
from pocketgs.training.strategies import choose
from pocketgs.training.strategies.adc import AdaptiveDensityControl, DensityControl
from pocketgs.training.strategies.budgeted import Budgeted, Growth, Parabola
from pocketgs.training.strategies.division import halves
from pocketgs.training.strategies.mcmc import MCMC, Relocation
from pocketgs.training.strategies.relocation import MAX_RATIO, compute_relocation
from pocketgs.training.strategies.strategy import StrategyContext
from pocketgs.training.train import train as prepare_and_train

train = partial(prepare_and_train, prior="none")

CONTEXT = StrategyContext(iterations=1000, most=150, measure_extent=lambda: 1.0, views=8, published_times=True)


class Rows:
    """The engine's operations for strategies, without images; tests set the statistics."""

    def __init__(self, scene: Gaussians) -> None:
        self.store = ParameterStore(scene)
        self.changes: list[RowChange] = []
        self.restart_statistics()

    @property
    def count(self) -> int:
        return self.store.count

    def change_rows(self, change: RowChange) -> None:
        self.changes.append(change)
        self.store.change_rows(change)
        self.restart_statistics()

    def download(self) -> Gaussians:
        return self.store.scene.select(np.arange(self.count))

    def statistics(self) -> Statistics:
        return self._statistics

    def restart_statistics(self, start: Statistics | None = None) -> None:
        self._statistics = start or Statistics.none_yet(self.count)


def scattered(count: int = 100, opacity: float = 0.5) -> Gaussians:
    rng = np.random.default_rng(4)
    return Gaussians(
        rng.normal(size=(count, 3)),
        rng.normal(-6.0, 0.5, (count, 3)),
        rng.normal(size=(count, 4)),
        np.full(count, np.log(opacity / (1 - opacity))),
        rng.normal(size=(count, 4, 3)),
    )


def covariances(scene: Gaussians) -> np.ndarray:
    axes = rotation_matrices(scene.quaternions.astype(np.float64)) * np.exp(scene.log_scales)[:, None, :]
    return axes @ np.swapaxes(axes, 1, 2)


# Relocation.


@settings(max_examples=50)
@given(st.floats(0.01, 0.99), st.integers(1, 20))
def test_those_who_share_hide_as_much_as_the_one(opacity: float, sharing: int) -> None:
    """Integrated along a line: ∫ 1 - (1 - o' exp(-x²/2s'²))^n dx = ∫ o exp(-x²/2) dx."""
    each, shrinking = compute_relocation(np.array([opacity]), np.array([sharing]))
    assert 1 - (1 - each[0]) ** sharing == pytest.approx(opacity, rel=1e-6)
    x = np.linspace(-12, 12, 20_001)
    together = 1 - (1 - each[0] * np.exp(-0.5 * (x / shrinking[0]) ** 2)) ** sharing
    # The line is cut where nothing is left of either.
    assert np.trapezoid(together, x) == pytest.approx(opacity * np.sqrt(2 * np.pi), rel=1e-4)


def test_sharing_with_nobody_changes_nothing() -> None:
    opacities = np.array([0.1, 0.5, 0.99])
    each, shrinking = compute_relocation(opacities, np.ones(3, int))
    np.testing.assert_allclose(each, opacities)
    np.testing.assert_allclose(shrinking, 1.0)
    many = compute_relocation(opacities, np.full(3, 500))
    np.testing.assert_array_equal(many, compute_relocation(opacities, np.full(3, MAX_RATIO)))
    assert np.isfinite(many).all()


def test_the_dead_move_onto_the_living_and_the_number_grows_to_its_bound() -> None:
    scene = scattered()
    scene.opacity_logits[:20] = -8.0
    scene.means[20] = np.nan
    engine = Rows(scene)
    chain = MCMC(CONTEXT)
    counts = []
    for iteration in range(1, 1001):
        chain.after_step(iteration, engine)  # type: ignore[arg-type]
        if iteration % 100 == 0:
            counts.append(engine.count)
    assert counts == [105, 110, 115, 120, 126, 132, 138, 144, 144, 144]
    after = engine.download()
    assert np.isfinite(after.means).all()
    assert after.opacities.min() > 0.005
    first = engine.changes[0]
    assert (first.sources[:21] > 20).all()
    assert first.fresh[:21].all()
    assert (first.sources[21:] == np.arange(21, 100)).all()
    full = MCMC(replace(CONTEXT, most=100))
    engine = Rows(scattered())
    full.after_step(100, engine)  # type: ignore[arg-type]
    assert engine.count == 100
    assert not engine.changes


def test_mcmc_prices_opacity_and_size_and_shakes_ever_less() -> None:
    chain = MCMC(replace(CONTEXT, measure_extent=lambda: 4.0))
    loss = chain.loss(LossSettings(dssim_weight=0.3))
    assert loss == LossSettings(dssim_weight=0.3, opacity_weight=0.01, size_weight=0.01 / 3 / 4)
    early, late = chain.noise(1, 1.0), chain.noise(2, 0.5)
    assert early is not None
    assert late is not None
    assert (early.size, late.size) == (20.0, 10.0)
    assert early == chain.noise(1, 1.0)
    assert early.seed != late.seed


# Cloning and splitting.


def test_halves_have_the_mean_and_covariance_of_the_whole() -> None:
    scene = scattered(50, opacity=0.6)
    offsets, log_scales, logits = halves(scene, np.arange(50))
    part = Gaussians(scene.means + offsets, log_scales, scene.quaternions, logits, scene.sh)
    together = covariances(part) + offsets[:, :, None] * offsets[:, None, :]
    np.testing.assert_allclose(together, covariances(scene), rtol=1e-4, atol=1e-12)
    hidden = 2 * part.opacities * part.scales.prod(axis=1)
    np.testing.assert_allclose(hidden, scene.opacities * scene.scales.prod(axis=1), rtol=1e-4)


def grown(
    scene: Gaussians, gradients: np.ndarray, most: int = 150, iteration: int = 600, iterations: int = 30_000
) -> Rows:
    engine = Rows(scene)
    count = len(scene)
    engine.restart_statistics(
        Statistics(gradients.astype(np.float32) * 2, np.full(count, 2, np.float32), *[np.zeros(count, np.float32)] * 2)
    )
    strategy = AdaptiveDensityControl(replace(CONTEXT, most=most, iterations=iterations))
    strategy.after_step(iteration, engine)  # type: ignore[arg-type]
    return engine


def test_the_small_are_cloned_and_the_large_split() -> None:
    scene = scattered()
    scene.log_scales[10] = np.log([0.02, 0.001, 0.001])
    gradients = np.zeros(100)
    gradients[[3, 10]] = 2.1e-4
    gradients[50] = 1.9e-4
    engine = grown(scene, gradients)
    after = engine.download()
    assert len(after) == 102  # one more of the clone, two in place of the one that is split
    for name in PARAMETERS:
        np.testing.assert_array_equal(getattr(after, name)[99], getattr(Rows(scene).download(), name)[3])
    parts = after.select(np.arange(100, 102))
    np.testing.assert_allclose(parts.scales, scene.scales[[10, 10]] / 1.6, rtol=1e-5)
    np.testing.assert_array_equal(parts.opacity_logits, scene.opacity_logits[[10, 10]])
    # Drawn from the Gaussian: within a few standard deviations, and not in the same place.
    distance = parts.means - scene.means[10]
    reach = np.einsum("ni,ij,nj->n", distance, np.linalg.inv(covariances(scene.select(np.array([10])))[0]), distance)
    assert (reach < 25).all()
    assert (parts.means[0] != parts.means[1]).any()
    assert engine.changes[0].fresh[99:].all()
    assert not engine.changes[0].fresh[:99].any()


def test_density_control_prunes_and_is_bounded() -> None:
    scene = scattered()
    scene.opacity_logits[:5] = -6.0
    scene.log_scales[7] = 0.0
    gradients = np.linspace(3e-4, 4e-4, 100)
    engine = grown(scene, gradients, most=110)
    # Those ten that have most gradient multiply; five are too faint. The large one goes after the first reset only.
    assert engine.count == 105
    np.testing.assert_array_equal(engine.changes[0].sources[95:], np.arange(90, 100))
    assert grown(scene, np.zeros(100), iteration=3100).count == 94
    for iteration in (500, 650, 15_000):
        assert not grown(scene, gradients, iteration=iteration).changes
    # After the last step nothing would train what is new.
    assert grown(scene, gradients, iteration=900, iterations=1000).changes
    assert not grown(scene, gradients, iteration=1000, iterations=1000).changes


@pytest.mark.parametrize(("iteration", "bright"), [(3000, False), (500, True)])
def test_opacities_are_reset(iteration: int, bright: bool) -> None:
    engine = Rows(scattered())
    engine.store.first_moments[:] = 1.0
    engine.store.second_moments[:] = 1.0
    statistics = replace(Statistics.none_yet(100), seen=np.ones(100, np.float32))
    engine.restart_statistics(statistics)
    strategy = AdaptiveDensityControl(replace(CONTEXT, bright=bright, iterations=30_000), DensityControl(every=7000))
    strategy.after_step(iteration, engine)  # type: ignore[arg-type]
    np.testing.assert_allclose(engine.download().opacities, 0.01, rtol=1e-5)
    assert not engine.store.first_moments[:, 9].any()
    assert engine.store.first_moments[:, :9].all()
    assert engine.store.second_moments[:, 10:].all()
    assert engine.statistics() is statistics


# Scenes of which nothing is left.


@pytest.mark.parametrize("logit", [-20.0, -np.inf, np.nan])
@pytest.mark.parametrize("name", ["adc", "mcmc", "budgeted"])
def test_a_scene_of_the_dead_keeps_someone(name: Any, logit: float) -> None:
    scene = scattered()
    scene.opacity_logits[:] = logit
    scene.opacity_logits[[7, 8]] = -9.0, -8.0
    scene.means[8] = np.nan
    engine = Rows(scene)
    strategy = choose.create_strategy(name, replace(CONTEXT, published_times=False))
    for iteration in range(1, 1001):
        strategy.after_step(iteration, engine)  # type: ignore[arg-type]
    after = engine.download()
    if name == "mcmc":
        assert not engine.changes
    else:
        assert np.isfinite(after.means).all()
        assert (engine.changes[0].sources == 7).all()
        assert 1 <= engine.count <= 150


# Times.


def test_times_of_short_runs_are_those_of_the_papers_scaled() -> None:
    for iterations in (30_000, 100_000):
        assert DensityControl.scaled(iterations) == DensityControl()
        assert Relocation.scaled(iterations) == Relocation()
    short = DensityControl.scaled(500)
    assert (short.start, short.stop, short.every) == (25, 250, 12)
    assert short == replace(DensityControl(), start=25, stop=250, every=12)
    assert Relocation.scaled(500) == replace(Relocation(), every=12)
    assert DensityControl.scaled(1).every == Relocation.scaled(1).every == 1


@pytest.mark.parametrize("is_published", [False, True])
def test_density_control_of_a_short_run_is_over_after_half_of_it(is_published: bool) -> None:
    context = replace(CONTEXT, iterations=500, published_times=is_published)
    strategy, engine = AdaptiveDensityControl(context), Rows(scattered())
    changed = []
    for iteration in range(1, 501):
        before = len(engine.changes)
        strategy.after_step(iteration, engine)  # type: ignore[arg-type]
        changed += [iteration] * (len(engine.changes) - before)
        assert strategy.collected(iteration).statistics == (is_published or iteration < 250)
    assert changed == ([] if is_published else list(range(36, 250, 12)))


def test_mcmc_doubles_the_number_within_a_short_run() -> None:
    counts = []
    for is_published in (False, True):
        engine = Rows(scattered())
        chain = MCMC(replace(CONTEXT, iterations=500, most=200, published_times=is_published))
        for iteration in range(1, 501):
            chain.after_step(iteration, engine)  # type: ignore[arg-type]
        counts.append(engine.count)
    assert counts == [200, 120]


def test_opacities_are_not_reset_at_the_start_of_a_short_run() -> None:
    """It would take half of the run to recover."""
    control = DensityControl(start=25, stop=250, every=7000)
    strategy, engine = AdaptiveDensityControl(replace(CONTEXT, bright=True), control), Rows(scattered())
    for iteration in range(1, 501):
        strategy.after_step(iteration, engine)  # type: ignore[arg-type]
    assert not engine.changes


@pytest.fixture
def contexts(monkeypatch: pytest.MonkeyPatch) -> list[StrategyContext]:
    """What strategies of runs are told."""
    told: list[StrategyContext] = []

    def make(context: StrategyContext) -> AdaptiveDensityControl:
        told.append(context)
        return AdaptiveDensityControl(context)

    monkeypatch.setitem(choose._KINDS, "adc", replace(choose._KINDS["adc"], make=make))
    return told


@pytest.mark.parametrize(("recipe", "is_published"), [("3dgs-7k", True), ("3dgs-30k", True), ("pocketgs", False)])
def test_3dgs_recipes_keep_their_times(
    small_capture: Capture, contexts: list[StrategyContext], recipe: str, is_published: bool
) -> None:
    train(small_capture, iterations=2, recipe=recipe, strategy="adc", max_gaussians=400, evaluate_every=0)
    assert [context.published_times for context in contexts] == [is_published]


def test_strategies_are_timed_for_what_a_time_budget_allows(
    small_capture: Capture, contexts: list[StrategyContext]
) -> None:
    options = SizedOptions(iterations=3, prior="none", strategy="adc", max_gaussians=400, evaluate_every=0)
    for expected in (None, 2, 30_000):
        train(small_capture, replace(options, expected_iterations=expected))
    assert [context.iterations for context in contexts] == [3, 2, 3]


# The budget.


def test_the_budget_is_met_exactly_where_errors_are() -> None:
    context = replace(CONTEXT, most=200)
    plan = Parabola(Growth(start=0.1, stop=0.5, times=5, first=0.5), context.iterations, context.most)
    targets = [plan.target(iteration, 100) for iteration in (100, 200, 300, 400, 500, 900)]
    assert targets == [100, 143, 175, 193, 200, 200]
    strategy = Budgeted(replace(context, growth=plan))
    scene = scattered()
    scene.opacity_logits[:10] = -6.0
    engine = Rows(scene)
    counts = []
    for iteration in range(1, 1001):
        collected = strategy.collected(iteration)
        assert collected.errors == any(grows - 8 < iteration <= grows for grows in (100, 200, 300, 400, 500))
        assert not collected.statistics
        errors = np.zeros(engine.count, np.float32)
        errors[20:30] = 1.0
        engine.restart_statistics(replace(Statistics.none_yet(engine.count), errors=errors))
        strategy.after_step(iteration, engine)  # type: ignore[arg-type]
        counts.append(engine.count)
    assert [counts[iteration - 1] for iteration in (99, 100, 200, 300, 400, 500, 1000)] == [
        100,
        100,
        143,
        175,
        193,
        200,
        200,
    ]
    first = engine.changes[0]
    assert set(range(20, 30)) <= set(first.sources[90:].tolist())
    assert len(first.sources) == 100


# Whole runs.


@pytest.fixture
def early(monkeypatch: pytest.MonkeyPatch) -> None:
    """Strategies that change the number within a few iterations."""
    control = DensityControl(start=4, stop=20, every=4, gradient=1e-6, reset_every=9)
    relocation = Relocation(start=0.1, every=3, dead=0.2)
    for name, make in (
        ("adc", lambda context: AdaptiveDensityControl(context, control)),
        ("mcmc", lambda context: MCMC(context, relocation)),
        ("budgeted", lambda context: Budgeted(context, Growth(start=0.2, stop=0.8, times=4))),
    ):
        monkeypatch.setitem(choose._KINDS, name, replace(choose._KINDS[name], make=make))


@pytest.mark.usefixtures("early")
@pytest.mark.parametrize("name", ["adc", "mcmc", "budgeted"])
def test_a_growing_run_resumes_to_the_same_bits(small_capture: Capture, tmp_path: Path, name: Any) -> None:
    options = TrainingOptions(iterations=24, sh_degree=1, strategy=name, max_gaussians=1800, evaluate_every=8)
    counts: list[int] = []
    checkpoints: list[Checkpoint] = []

    def watch(progress: Progress) -> None:
        counts.append(progress.gaussians)
        # Between two changes, so that something has been collected since the last.
        if progress.iteration == 10:
            checkpoints.append(progress.checkpoint())

    whole = train(small_capture, options, observer=watch)
    assert counts[0] == choose.most_at_start(name, 1800) == (1440 if name == "budgeted" else 900)
    assert max(counts) <= 1800
    assert len(set(counts)) >= 3
    assert counts[-1] == len(whole.scene)
    assert [sample.gaussians for sample in whole.losses] == [counts[7], counts[15], counts[23]]
    write_checkpoint(tmp_path / CHECKPOINT, checkpoints[0], {SHRINK: 1, MAX_GAUSSIANS: 1800})
    assert read_size(tmp_path) == (1, 1800)
    resumed = train(small_capture, options, resume=read_checkpoint(tmp_path, {}))
    for part in PARAMETERS:
        assert getattr(resumed.scene, part).tobytes() == getattr(whole.scene, part).tobytes(), part
    for part in ("first_moments", "second_moments"):
        one, other = (getattr(result.checkpoint.state, part) for result in (resumed, whole))
        assert one.tobytes() == other.tobytes()


@pytest.mark.usefixtures("early", "adapter")
@pytest.mark.parametrize("name", ["adc", "mcmc", "budgeted"])
def test_engines_agree_on_how_many_there_are(
    small_capture: Capture, name: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their PSNR agrees too, and a growing run on the GPU resumes to the same bits.

    Strategies are compared without dropout, which has tests of its own.
    """
    monkeypatch.setattr(run_setup, "dropout_share", lambda most, views: 0.0)
    options = TrainingOptions(iterations=24, sh_degree=1, strategy=name, max_gaussians=1800, evaluate_every=8)
    checkpoints: list[Checkpoint] = []

    def watch(progress: Progress) -> None:
        if progress.iteration == 10:
            checkpoints.append(progress.checkpoint())

    on_cpu = train(small_capture, options)
    on_gpu = train(small_capture, replace(options, engine="webgpu"), observer=watch)
    counts = [[sample.gaussians for sample in result.losses] for result in (on_gpu, on_cpu)]
    np.testing.assert_allclose(*counts, rtol=0.0 if name == "budgeted" else 0.02)
    psnrs = [[sample.held_out_psnr for sample in result.losses] for result in (on_gpu, on_cpu)]
    # Rounding changes which Gaussians are drawn at random: two CPU runs whose rates differ by 1e-5 part by half a dB.
    np.testing.assert_allclose(*psnrs, atol=1.0 if name == "mcmc" else 0.1)
    resumed = train(small_capture, replace(options, engine="webgpu"), resume=checkpoints[0])
    for part in PARAMETERS:
        assert getattr(resumed.scene, part).tobytes() == getattr(on_gpu.scene, part).tobytes(), part


def test_ctrl_c_keeps_what_was_collected(small_capture: Capture) -> None:
    def press_ctrl_c(progress: Progress) -> None:
        if progress.iteration == 5:
            signal.raise_signal(signal.SIGINT)

    stopped = train(small_capture, iterations=400, strategy="adc", max_gaussians=400, observer=press_ctrl_c)
    assert (stopped.iterations, stopped.strategy) == (5, "adc")
    assert stopped.checkpoint.statistics is not None
    assert stopped.checkpoint.statistics.seen.max() == 5


# Options and recipes.


def test_recipes_win_over_effort_and_users_over_both() -> None:
    views = [(800, 800)] * 100
    found = sized(TrainingOptions(recipe="3dgs-7k", effort="quick"), views)
    assert (found.iterations, found.max_gaussians, found.strategy) == (7000, 500_000, "adc")
    assert (found.prior, found.seeds, found.max_keyframes) == ("none", "balls", 40)
    found = sized(TrainingOptions(recipe="3dgs-30k", iterations=5, prior="dense", strategy="mcmc"), views)
    assert (found.iterations, found.prior, found.strategy, found.most_at_start) == (5, "dense", "mcmc", 250_000)
    found = sized(TrainingOptions(), views)
    assert (found.prior, found.seeds, found.strategy) == ("dense", "discs", "fixed")
    assert found.most_at_start == found.max_gaussians


def test_3dgs_recipes_are_one_recipe_of_two_lengths() -> None:
    short, long = recipe_named("3dgs-7k"), recipe_named("3dgs-30k")
    at_3000 = [recipe.schedule(recipe.rates, 3000 / (recipe.iterations or 0)) for recipe in (short, long)]
    assert at_3000[0].means == pytest.approx(at_3000[1].means)
    assert at_3000[0].means == pytest.approx(1.6e-4 * 0.01**0.1)
    assert [short.active_degree(iteration) for iteration in (1, 999, 1000, 2000, 3000, 7000)] == [0, 0, 1, 2, 3, 3]
    assert recipe_named("pocketgs").active_degree(1) is None


def test_a_strategy_that_there_is_not_is_refused() -> None:
    with pytest.raises(PocketGSError, match="strategy: found grow, expected fixed, adc, mcmc or budgeted"):
        TrainingOptions(strategy="grow")  # type: ignore[arg-type]
    with pytest.raises(PocketGSError, match="prior: found best, expected dense, sparse, colmap or none"):
        TrainingOptions(prior="best")  # type: ignore[arg-type]


def test_random_points_fill_a_cube_before_the_cameras(small_capture: Capture) -> None:
    cameras = [frame.camera for frame in small_capture.train]
    points = points_in_a_cube(cameras, 500, seed=1)
    assert len(points) == 500
    np.testing.assert_array_equal(points.positions, points_in_a_cube(cameras, 500, seed=1).positions)
    sides = np.ptp(points.positions, axis=0)
    assert sides.max() < 1.05 * sides.min()


@pytest.mark.parametrize("brightness", [0.0, 1.0])
def test_opacities_are_reset_early_before_a_bright_background(small_capture: Capture, brightness: float) -> None:
    """As 3DGS does where densification begins: the background of objects on white."""
    capture = PreparedCapture.of(replace(small_capture, background=(brightness,) * 3), None)
    assert capture.points is not None
    sizes = [(frame.camera.width, frame.camera.height) for frame in capture.train]
    options = sized(TrainingOptions(recipe="3dgs-7k", prior="none"), sizes)
    strategy, engine = set_up(capture, capture.points, options, None, None).strategy, CpuEngine()
    engine.upload(seed_balls(capture.points, 0.9, 0))
    strategy.after_step(500, engine)
    assert engine.download().opacities.max() == pytest.approx(0.01 if brightness else 0.9)
