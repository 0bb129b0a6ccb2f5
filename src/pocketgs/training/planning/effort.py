"""Effort: how many Gaussians, keyframes and iterations a capture is worth.

A capture with four times the pixels shows more, but not four times as much, since its views overlap: Gaussians grow
with the square root of the pixels of all training views together. The time of training grows a little faster, since
each Gaussian is seen in a smaller share of the steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

from pocketgs.training.options import SizedOptions, TrainingOptions
from pocketgs.training.planning.time_model import step_seconds
from pocketgs.training.recipes import recipe_named

QUICK_ITERATIONS, QUICK_GAUSSIANS, QUICK_KEYFRAMES = 500, 50_000, 40
STANDARD_KEYFRAMES = 100

SMALL_CAPTURE = 3_000_000
"""Pixels of a capture that the least of `standard` is made for: some twenty photographs of 500 x 370."""

MIN_GAUSSIANS, MAX_GAUSSIANS = 50_000, 150_000
MIN_SECONDS, MAX_SECONDS = 35.0, 190.0
"""Of training, on the machine that the time model was measured on."""

GAUSSIANS_POWER, SECONDS_POWER = 0.5, 0.75
"""With which powers of the pixels they grow."""

MIN_ITERATIONS, MAX_ITERATIONS = 500, 3000

OF_THE_RECIPE = ("iterations", "max_gaussians", "prior", "seeds", "strategy")
"""Options that a recipe may state; what the user gives wins over it, and it over the effort."""

MAX_EPOCHS = 40
"""Times that each photograph is trained on: of few photographs, more learn the noise of each rather than the scene."""


def sized(options: TrainingOptions, views: Sequence[tuple[int, int]]) -> SizedOptions:
    """The options with the sizes that their effort gives to a capture; sizes that the user has given stay.

    Sizes follow from the capture alone, never from the machine: the same command gives the same scene everywhere.

    Args:
        options: of the run.
        views: width and height of every training view.
    """
    if isinstance(options, SizedOptions):
        return options
    recipe = recipe_named(options.recipe)
    given = {field.name: getattr(options, field.name) for field in fields(options)}
    for name in OF_THE_RECIPE:
        given[name] = getattr(recipe, name) if given[name] is None else given[name]
    options = replace(options, max_gaussians=given["max_gaussians"])
    sizes = _quick() if options.effort == "quick" else _standard(options, views)
    return SizedOptions(**{**given, **{name: size for name, size in sizes.items() if given[name] is None}})


def _quick() -> dict[str, int]:
    return {"iterations": QUICK_ITERATIONS, "max_gaussians": QUICK_GAUSSIANS, "max_keyframes": QUICK_KEYFRAMES}


def _standard(options: TrainingOptions, views: Sequence[tuple[int, int]]) -> dict[str, int]:
    pixels = sum(width * height for width, height in views)
    growth = max(pixels / SMALL_CAPTURE, 1.0)
    gaussians = options.max_gaussians or min(int(MIN_GAUSSIANS * growth**GAUSSIANS_POWER), MAX_GAUSSIANS)
    degree = recipe_named(options.recipe).sh_degree if options.sh_degree is None else options.sh_degree
    step = step_seconds(gaussians, (degree + 1) ** 2, pixels / max(len(views), 1))
    iterations = int(min(MIN_SECONDS * growth**SECONDS_POWER, MAX_SECONDS) / step)
    iterations = min(iterations, MAX_EPOCHS * len(views), MAX_ITERATIONS)
    return {
        "iterations": max(iterations, MIN_ITERATIONS),
        "max_gaussians": gaussians,
        "max_keyframes": STANDARD_KEYFRAMES,
    }
