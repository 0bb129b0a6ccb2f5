"""Effort: choosing the number of Gaussians, keyframes and iterations for a capture.

A capture with four times the pixels shows more, but not four times as much, since its views overlap: the number of
Gaussians grows with the square root of the pixels of all training views together. Training time grows a little faster,
since each Gaussian is seen in fewer of the steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

from pocketgs.training.options import SizedOptions, TrainingOptions
from pocketgs.training.planning.time_model import step_seconds
from pocketgs.training.recipes import Recipe, recipe_named
from pocketgs.training.validation import validation_views

QUICK_ITERATIONS, QUICK_GAUSSIANS, QUICK_KEYFRAMES = 500, 50_000, 40
STANDARD_KEYFRAMES = 100

SMALL_CAPTURE = 3_000_000
"""Pixels of the smallest capture that `standard` is tuned for: some twenty photographs of 500 x 370."""

FEWEST_GAUSSIANS, MOST_GAUSSIANS = 50_000, 150_000
MIN_SECONDS, MAX_SECONDS = 35.0, 190.0
"""Bounds of the training time, on the machine that the time model was measured on."""

GAUSSIANS_POWER, SECONDS_POWER = 0.5, 0.75
"""Exponents of their growth with the number of pixels."""

MIN_ITERATIONS, MAX_ITERATIONS = 500, 3000

MAX_OPEN_ENDED, MAX_OPEN_ENDED_EPOCHS = 20_000, 60
"""Maximum iterations of a run that trains until it stops paying, and maximum visits to each photograph: validation
views gain a little by every decrease of the learning rates, even where longer training overfits."""

OPEN_ENDED_GAUSSIANS = 2
"""Maximum number of Gaussians of such a run relative to `standard`. It begins with half of them, or with 0.8 of them
if the user sets the iterations, and grows."""

OPEN_ENDED_STRATEGIES = ("budgeted", "fixed")

OF_THE_RECIPE = ("iterations", "max_gaussians", "prior", "seeds", "strategy")
"""Options that a recipe may set. The user's values take precedence over it, and it takes precedence over the effort."""

MAX_EPOCHS = 40
"""Maximum number of times that each photograph is trained on: with few photographs, more would overfit.

Fewer than 13 photographs are each trained on more often, since `MIN_ITERATIONS` takes precedence.
"""


def sized(options: TrainingOptions, views: Sequence[tuple[int, int]]) -> SizedOptions:
    """Fill in the sizes that the effort chooses for a capture; sizes set by the user are kept.

    Sizes depend on the capture alone, not on the machine: the same command gives the same scene everywhere.

    Args:
        options: of the run.
        views: width and height of every training view.
    """
    if isinstance(options, SizedOptions):
        return options
    standard_recipe = recipe_named("pocketgs")
    recipe = recipe_named(options.recipe or ("long" if options.effort == "best" else standard_recipe.name))
    options = replace(options, recipe=recipe.name)
    strategy = options.strategy or recipe.strategy
    # Other strategies act at shares of a run's length, which is unknown here.
    grows = recipe.open_ended and strategy in OPEN_ENDED_STRATEGIES and bool(validation_views(len(views)))
    open_ended = grows and options.iterations is None
    given = {field.name: getattr(options, field.name) for field in fields(options)}
    for name in OF_THE_RECIPE:
        given[name] = getattr(recipe, name) if given[name] is None else given[name]
    options = replace(options, max_gaussians=given["max_gaussians"])
    # `best` is at least as long as `standard`, though the steps of its own recipe take longer.
    timed = standard_recipe if options.effort == "best" else recipe
    sizes = _quick() if options.effort == "quick" else _standard(options, timed, views)
    least = sizes["iterations"]
    if grows:
        longest = max(min(MAX_OPEN_ENDED, MAX_OPEN_ENDED_EPOCHS * len(views)), least)
        sizes |= {"iterations": longest, "max_gaussians": OPEN_ENDED_GAUSSIANS * sizes["max_gaussians"]}
    usual = recipe.iterations or sizes["iterations"]
    sizes = {name: size for name, size in sizes.items() if given[name] is None}
    return SizedOptions(**{**given, **sizes}, open_ended=open_ended, least_iterations=least, usual_iterations=usual)


def _quick() -> dict[str, int]:
    return {"iterations": QUICK_ITERATIONS, "max_gaussians": QUICK_GAUSSIANS, "max_keyframes": QUICK_KEYFRAMES}


def _standard(options: TrainingOptions, recipe: Recipe, views: Sequence[tuple[int, int]]) -> dict[str, int]:
    pixels = sum(width * height for width, height in views)
    growth = max(pixels / SMALL_CAPTURE, 1.0)
    gaussians = options.max_gaussians or min(int(FEWEST_GAUSSIANS * growth**GAUSSIANS_POWER), MOST_GAUSSIANS)
    step = step_seconds(gaussians, (recipe.degree_for(options.sh_degree) + 1) ** 2, pixels / max(len(views), 1))
    iterations = int(min(MIN_SECONDS * growth**SECONDS_POWER, MAX_SECONDS) / step)
    iterations = min(iterations, MAX_EPOCHS * len(views), MAX_ITERATIONS)
    return {
        "iterations": max(iterations, MIN_ITERATIONS),
        "max_gaussians": gaussians,
        "max_keyframes": STANDARD_KEYFRAMES,
    }
