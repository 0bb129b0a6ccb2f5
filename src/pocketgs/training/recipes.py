"""Training recipes: loss, learning rates and their schedule, and seeding."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import Gaussians
from pocketgs.scene.point_cloud import PointCloud
from pocketgs.splat.settings import AdamSettings, LearningRates, LossSettings
from pocketgs.training.strategies.choose import StrategyName

Seeds = Literal["discs", "balls"]
Prior = Literal["dense", "sparse", "colmap", "none"]
RecipeName = Literal["pocketgs", "reference", "3dgs-7k", "3dgs-30k", "long"]

Schedule = Callable[[LearningRates, float], LearningRates]
"""Maps the initial rates and the progress of the run, 0 to 1, to the rates of an iteration."""

MAX_DEGREE = 3

SLOWEST_SCALES = 0.5
"""Minimum share of the scales' learning rate in the longest runs, which are often stopped early."""

MIN_EXTENT = 1e-6
"""Minimum extent of the cameras relative to their distance from the points; less is rounding error."""

MOST_DEPTHS = 10_000_000
"""Maximum number of depths that the median of a pixel's footprint is taken over: they take 240 MB."""


def cosine(final: float) -> Schedule:
    """All rates decay along a half cosine from 1 to `final` times their initial values."""

    def rates(initial: LearningRates, progress: float) -> LearningRates:
        return initial.scaled(final + (1.0 - final) * 0.5 * (1.0 + math.cos(math.pi * min(progress, 1.0))))

    return rates


def exponential_means(final: float) -> Schedule:
    """The rate of the means decays exponentially from 1 to `final` times its initial value; the others stay constant.

    3DGS's schedule, stretched over the run's length as in gsplat and OpenSplat.
    """

    def rates(initial: LearningRates, progress: float) -> LearningRates:
        return replace(initial, means=initial.means * final ** min(progress, 1.0))

    return rates


def pixel_footprint(cameras: Sequence[Camera], points: PointCloud) -> float:
    """Footprint of a pixel at the scene: the median over cameras and visible points of depth / focal length.

    Raises:
        PocketGSError: no camera sees a point.
    """
    ratios = []
    positions = points.positions[:: 1 + len(cameras) * len(points) // MOST_DEPTHS].astype(np.float64)
    for camera in cameras:
        pixels, depth = camera.project(positions)
        seen = camera.shows(pixels, depth)
        ratios.append(depth[seen] / math.sqrt(camera.fx * camera.fy))
    together = np.concatenate(ratios)
    if len(together) == 0:
        raise PocketGSError(
            f"none of the {len(cameras)} cameras sees any of the {len(points)} points: are poses right?"
        )
    return float(np.median(together))


def camera_extent(cameras: Sequence[Camera], points: PointCloud) -> float:
    """3DGS's extent of a scene: 1.1 times the largest distance of a camera from the cameras' mean.

    Raises:
        PocketGSError: all cameras are in one place, so that nothing would move.
    """
    centres = np.array([camera.centre for camera in cameras])
    extent = 1.1 * float(np.linalg.norm(centres - centres.mean(axis=0), axis=1).max())
    distance = float(np.median(np.linalg.norm(points.positions - centres.mean(axis=0), axis=1)))
    if extent <= MIN_EXTENT * distance:
        raise PocketGSError(
            f"the training cameras ({len(cameras)}) stand in one place, which gives the recipe or the strategy no "
            "length to measure steps in: expected cameras that moved, or the recipe 'pocketgs' and the strategy 'fixed'"
        )
    return extent


@dataclass(frozen=True)
class Recipe:
    """A training recipe.

    Attributes:
        name: for reports.
        rates: initial learning rates; that of the means in units of `length`.
        length: computes the unit of length from the training cameras and the initial points.
        schedule: of the learning rates.
        loss: of training.
        adam: settings of the optimiser.
        opacity: initial opacity of the seeds.
        seed_size: scale of a seed, as a multiple of the distance to its neighbours.
        sh_degree: degree of the spherical harmonics.
        sh_every: iterations after which training of the next degree begins; None trains all degrees from the start.
        seeds: shape of the seeds, "discs" or "balls".
        prior: initial points, see `TrainingOptions.prior`.
        random_points: number of random points in a cube for captures without points; None draws them where the
            photographs agree.
        strategy: how the number of Gaussians changes.
        published_times: whether the strategies of 3DGS and of 3DGS-MCMC act at the iterations of their papers, however
            short the run is.
        iterations, max_gaussians: of a run, or None to use the effort's.
        open_ended: train until it stops paying, unless the user sets the iterations.
        masks_transients: whether `TrainingOptions.transients` applies.
        dropout: share of the Gaussians that each step leaves out where few views show the scene.
        scales_for: number of iterations that the rate of the scales is tuned for, or None for any. Gradient noise lets
            scales drift with the square root of the number of steps, so in longer runs their rate is lower.
    """

    name: RecipeName
    rates: LearningRates
    length: Callable[[Sequence[Camera], PointCloud], float]
    schedule: Schedule
    loss: LossSettings = field(default_factory=LossSettings)
    adam: AdamSettings = field(default_factory=AdamSettings)
    opacity: float = 0.1
    seed_size: float = 1.0
    sh_degree: int = 0
    sh_every: int | None = None
    seeds: Seeds = "discs"
    prior: Prior = "dense"
    random_points: int | None = None
    strategy: StrategyName = "fixed"
    published_times: bool = False
    iterations: int | None = None
    max_gaussians: int | None = None
    open_ended: bool = False
    masks_transients: bool = False
    dropout: float = 0.0
    scales_for: int | None = None

    def degree_for(self, asked: int | None) -> int:
        """Degree of the spherical harmonics of a run that asks for one, or for none."""
        return self.sh_degree if asked is None else asked

    def active_degree(self, iteration: int) -> int | None:
        """Maximum degree of spherical harmonics that iteration `iteration`, counted from 1, trains; None for all."""
        return None if self.sh_every is None else min(iteration // self.sh_every, MAX_DEGREE)

    def rates_for(self, iterations: int, unit: float) -> LearningRates:
        """Initial learning rates of a run.

        Args:
            iterations: of the run.
            unit: result of `length`.
        """
        slower = math.sqrt(self.scales_for / iterations) if self.scales_for else 1.0
        slower = min(max(slower, SLOWEST_SCALES), 1.0)
        return replace(self.rates, means=self.rates.means * unit, log_scales=self.rates.log_scales * slower)

    def rates_for_scene(self, iterations: int, cameras: Sequence[Camera], scene: Gaussians) -> LearningRates:
        """Initial learning rates for training a scene further; the scene gives the unit of length.

        Args:
            iterations: of the run.
            cameras: the training cameras.
            scene: to start from.

        Raises:
            PocketGSError: the scene gives no unit of length; see `length`.
        """
        points = PointCloud(scene.means, np.zeros((len(scene), 3), np.float32))
        return self.rates_for(iterations, self.length(cameras, points))


# 3DGS's rates. Rotations are updated in the tangent space, q ⊗ exp(½δ), so their rate is twice that of quaternions.
_3DGS_RATES = LearningRates(
    means=1.6e-4, log_scales=5e-3, rotations=2e-3, opacity_logits=0.05, sh_dc=2.5e-3, sh_rest=1.25e-4
)
_3DGS_ITERATIONS = 30_000


def _3dgs(name: RecipeName, iterations: int) -> Recipe:
    """3DGS's complete recipe, up to an iteration, with the decay of the run of 30,000 (Kerbl et al. 2023)."""
    return Recipe(
        name=name,
        rates=_3DGS_RATES,
        length=camera_extent,
        schedule=exponential_means(final=0.01 ** (iterations / _3DGS_ITERATIONS)),
        sh_degree=3,
        sh_every=1000,
        seeds="balls",
        prior="none",
        random_points=100_000,
        strategy="adc",
        published_times=True,
        iterations=iterations,
        max_gaussians=500_000,
    )


_POCKETGS = Recipe(
    # For a few hundred iterations: large steps, measured in pixels, that decay together.
    name="pocketgs",
    rates=LearningRates(means=0.2, log_scales=0.16, rotations=0.032, opacity_logits=0.1, sh_dc=0.03, sh_rest=0.008),
    length=pixel_footprint,
    schedule=cosine(final=0.02),
    # A second moment averaged over twenty steps instead of a thousand follows the gradients of short runs.
    adam=AdamSettings(beta2=0.95, seen_only=True),
    opacity=0.25,
    seed_size=0.6,
    sh_degree=2,
    masks_transients=True,
    dropout=0.1,
    scales_for=500,
)

RECIPES: dict[str, Recipe] = {
    recipe.name: recipe
    for recipe in (
        _POCKETGS,
        # 3DGS's rates for a fair comparison: a fixed number of Gaussians, and rates that decay over runs of any length.
        Recipe(name="reference", rates=_3DGS_RATES, length=camera_extent, schedule=exponential_means(final=0.01)),
        _3dgs("3dgs-7k", 7000),
        _3dgs("3dgs-30k", 30_000),
        # Trains as long as it pays: from the dense cloud, growing where there are errors.
        replace(_POCKETGS, name="long", strategy="budgeted", open_ended=True, sh_degree=3, sh_every=250),
    )
}


def recipe_named(name: str) -> Recipe:
    """The recipe with this name.

    Raises:
        PocketGSError: it does not exist.
    """
    if name not in RECIPES:
        raise PocketGSError(f"recipe {name!r}: not known, expected one of {', '.join(RECIPES)}")
    return RECIPES[name]
