"""Settings of a training step."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, get_args

from pocketgs.errors import PocketGSError
from pocketgs.scene.background import Background, checked_background
from pocketgs.scene.gaussians import SH_COEFFICIENTS

Photometric = Literal["l2", "l1-dssim"]
HIGHEST_SEED = 2**32 - 1


@dataclass(frozen=True)
class LearningRates:
    """Adam's step sizes by parameter group.

    Attributes:
        means: scene units.
        log_scales: natural logarithm of length.
        rotations: radians in the Gaussian's tangent space.
        opacity_logits: logit.
        sh_dc, sh_rest: spherical-harmonics coefficients of degree 0, and above.

    Raises:
        PocketGSError: a rate is negative or not finite.
    """

    means: float
    log_scales: float
    rotations: float
    opacity_logits: float
    sh_dc: float
    sh_rest: float

    def __post_init__(self) -> None:
        for name, rate in vars(self).items():
            _check_size(f"rate of {name}", rate)

    def scaled(self, factor: float) -> LearningRates:
        """All rates times `factor`."""
        return LearningRates(
            self.means * factor,
            self.log_scales * factor,
            self.rotations * factor,
            self.opacity_logits * factor,
            self.sh_dc * factor,
            self.sh_rest * factor,
        )


@dataclass(frozen=True)
class LossSettings:
    """The training loss.

    Attributes:
        photometric: "l2", the mean squared error (the PocketGS paper), or "l1-dssim",
            (1 - dssim_weight) · mean|x - y| + dssim_weight · (1 - SSIM) (3DGS, equation 7).
        dssim_weight: share of the structural term.
        scale_weight: weight of the mean over Gaussians of ‖log s‖².
        opacity_weight: weight of the mean over Gaussians of the opacity.
        size_weight: weight of the mean over Gaussians of the sum of their three standard deviations, in inverse units
            of length.

    Raises:
        PocketGSError: there is no such loss, the structural share is not from 0 to 1, or a weight is negative or not
            finite.
    """

    photometric: Photometric = "l1-dssim"
    dssim_weight: float = 0.2
    scale_weight: float = 0.0
    opacity_weight: float = 0.0
    size_weight: float = 0.0

    def __post_init__(self) -> None:
        if self.photometric not in get_args(Photometric):
            expected = " or ".join(get_args(Photometric))
            raise PocketGSError(f"loss: found {self.photometric!r}, expected {expected}")
        if not 0.0 <= self.dssim_weight <= 1.0:
            raise PocketGSError(f"loss: found a structural share of {self.dssim_weight}, expected one from 0 to 1")
        for name in ("scale_weight", "opacity_weight", "size_weight"):
            _check_size(name, getattr(self, name))


@dataclass(frozen=True)
class AdamSettings:
    """Settings of Adam (Kingma and Ba 2015, algorithm 1).

    Attributes:
        beta1, beta2: decay rates of the moments.
        epsilon: guard against division by zero.
        seen_only: Gaussians that a view does not see keep their parameters and moments. Otherwise they drift, and
            rarely seen ones move too far: a gradient that comes every n-th step is divided by a root mean square that
            has decayed in between.

    Raises:
        PocketGSError: a decay rate is not from 0 to below 1, or epsilon is not positive and finite.
    """

    beta1: float = 0.9
    beta2: float = 0.999
    epsilon: float = 1e-15
    seen_only: bool = False

    def __post_init__(self) -> None:
        for name in ("beta1", "beta2"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise PocketGSError(f"Adam: found a {name} of {getattr(self, name)}, expected one from 0 to below 1")
        if not 0.0 < self.epsilon < math.inf:
            raise PocketGSError(f"Adam: found an epsilon of {self.epsilon}, expected a positive number")


@dataclass(frozen=True)
class ColourSettings:
    """Settings for learning the colour transform of a photograph; see `pocketgs.splat.colours`.

    Attributes:
        rate: Adam's step size, for factors and display values.
        weight: of ‖A − I‖² + ‖b‖². The reported loss does not include this term.

    Raises:
        PocketGSError: one of them is negative or not finite.
    """

    rate: float
    weight: float = 0.0

    def __post_init__(self) -> None:
        _check_size("rate of colours", self.rate)
        _check_size("weight of colours", self.weight)


@dataclass(frozen=True)
class PositionNoise:
    """Noise on the positions of transparent Gaussians, added after the update (3DGS-MCMC, equation 8).

    Attributes:
        size: factor on Σ η, in inverse units of length.
        seed: of the noise of this step, 0 to 2³² - 1.

    Raises:
        PocketGSError: the size is negative or not finite, or the seed is out of range.
    """

    size: float
    seed: int

    def __post_init__(self) -> None:
        _check_size("size of the noise", self.size)
        _check_seed("noise", self.seed)


@dataclass(frozen=True)
class Dropout:
    """A random share of the Gaussians that a step does not draw (DropGaussian, Park et al. 2025).

    Their gradients are 0. They still move by their momentum, except with `AdamSettings.seen_only`.

    Attributes:
        share: of the Gaussians, from 0 to below 1.
        seed: of this step's choice, 0 to 2³² - 1.

    Raises:
        PocketGSError: the share or the seed is out of range.
    """

    share: float
    seed: int

    def __post_init__(self) -> None:
        if not 0.0 <= self.share < 1.0:
            raise PocketGSError(f"dropout: found a share of {self.share}, expected one from 0 to below 1")
        _check_seed("dropout", self.seed)

    @property
    def threshold(self) -> int:
        """Gaussians are left out whose hash, 32 bits of the seed and the row, is below."""
        return int(self.share * 2**32)


@dataclass(frozen=True)
class StepSettings:
    """One training step.

    Attributes:
        rates: learning rates of this iteration.
        loss: to minimise.
        adam: settings of Adam.
        background: behind the scene, RGB in [0, 1].
        sh_degree: maximum degree of the trained coefficients; higher ones and their moments stay. None trains all.
        statistics: whether to add this step to `Engine.statistics`.
        errors: whether to add this view's errors to the statistics too, which takes about a third of a step.
        noise: on positions, or None.
        dropout: of Gaussians, or None to draw them all.
        colours: for learning the photograph's colour transform, or None to compare rendered colours unchanged.

    Raises:
        PocketGSError: the background is not a colour, or there are no coefficients of such a degree.
    """

    rates: LearningRates
    loss: LossSettings = field(default_factory=LossSettings)
    adam: AdamSettings = field(default_factory=AdamSettings)
    background: Background = (0.0, 0.0, 0.0)
    sh_degree: int | None = None
    statistics: bool = False
    errors: bool = False
    noise: PositionNoise | None = None
    dropout: Dropout | None = None
    colours: ColourSettings | None = None

    def __post_init__(self) -> None:
        checked_background(self.background)
        if self.sh_degree is not None and self.sh_degree not in range(len(SH_COEFFICIENTS)):
            highest = len(SH_COEFFICIENTS) - 1
            raise PocketGSError(f"step: found an sh_degree of {self.sh_degree}, expected 0 to {highest}")


def _check_size(what: str, found: float) -> None:
    if not 0.0 <= found < math.inf:
        raise PocketGSError(f"step: found a {what} of {found}, expected a finite number that is not negative")


def _check_seed(what: str, found: int) -> None:
    if not 0 <= found <= HIGHEST_SEED:
        raise PocketGSError(f"{what}: found the seed {found}, expected 0 to {HIGHEST_SEED}")
