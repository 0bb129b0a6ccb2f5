"""What a run follows: its recipe, learning rates, pace, strategy and dropout."""

from __future__ import annotations

from dataclasses import dataclass

from pocketgs.prior.prior import PreparedCapture
from pocketgs.scene.point_cloud import PointCloud
from pocketgs.splat.settings import LearningRates
from pocketgs.training.dropout import dropout_share, views_per_point
from pocketgs.training.open_ended import OpenEndedPace
from pocketgs.training.options import SizedOptions
from pocketgs.training.pace import SetPace
from pocketgs.training.recipes import Recipe, camera_extent, recipe_named
from pocketgs.training.result import Checkpoint
from pocketgs.training.strategies.choose import create_strategy
from pocketgs.training.strategies.strategy import GrowthPlan, Strategy, StrategyContext


@dataclass(frozen=True)
class RunSetup:
    """What a run follows.

    Attributes:
        recipe: of the loss and the optimiser.
        first_rates: initial learning rates.
        pace: the run's length and learning rates.
        strategy: changes the number of Gaussians.
        dropout: share of the Gaussians that each step leaves out.
    """

    recipe: Recipe
    first_rates: LearningRates
    pace: OpenEndedPace | SetPace
    strategy: Strategy
    dropout: float


def set_up(
    capture: PreparedCapture,
    points: PointCloud,
    options: SizedOptions,
    seconds: float | None,
    resume: Checkpoint | None,
) -> RunSetup:
    """Choose what a run follows.

    Args:
        capture: to train on.
        points: that the first Gaussians are made from.
        options: of the run.
        seconds: for training, or None for no limit.
        resume: checkpoint of the run to resume, or None.
    """
    recipe = recipe_named(options.recipe)
    cameras = [frame.camera for frame in capture.train]
    # Learning rates decay within the time that there is, and whatever else follows the length of the run should too.
    iterations = min(options.iterations, options.expected_iterations or options.iterations)
    rates = recipe.rates_for(iterations, recipe.length(cameras, points))
    dropout = dropout_share(recipe.dropout, views_per_point(cameras, points)) if recipe.dropout else 0.0
    pace = _pace(capture, options, recipe, rates, seconds, resume)
    growth = pace if isinstance(pace, OpenEndedPace) else None
    strategy = create_strategy(options.strategy, _context(capture, points, options, recipe, iterations, growth))
    return RunSetup(recipe, rates, pace, strategy, dropout)


def _pace(
    capture: PreparedCapture,
    options: SizedOptions,
    recipe: Recipe,
    rates: LearningRates,
    seconds: float | None,
    resume: Checkpoint | None,
) -> OpenEndedPace | SetPace:
    """As long as training pays, or as long as the options say."""
    history = resume.history if resume else None
    if options.open_ended:
        least, most, gaussians = options.least_iterations, options.iterations, options.max_gaussians
        return OpenEndedPace(least, most, seconds, rates, capture.train, capture.background, gaussians, history)
    return SetPace(options.iterations, seconds, recipe.schedule, rates, len(capture.train), history)


def _context(
    capture: PreparedCapture,
    points: PointCloud,
    options: SizedOptions,
    recipe: Recipe,
    iterations: int,
    growth: GrowthPlan | None,
) -> StrategyContext:
    return StrategyContext(
        iterations=iterations,
        most=options.max_gaussians,
        measure_extent=lambda: camera_extent([frame.camera for frame in capture.train], points),
        views=len(capture.train),
        seed=options.seed,
        bright=max(capture.background) > 0,
        published_times=recipe.published_times,
        growth=growth,
    )
