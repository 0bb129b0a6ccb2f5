"""Options of a training run."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

from pocketgs.errors import PocketGSError
from pocketgs.prior.prior import Exposure
from pocketgs.splat.engine import Accumulation, EngineName, EngineOptions, Precision, Replay
from pocketgs.training.colours import COLOURS, Colours
from pocketgs.training.recipes import Prior, RecipeName, Seeds, recipe_named
from pocketgs.training.strategies.choose import STRATEGIES, StrategyName, most_at_start

Effort = Literal["quick", "standard", "best"]


@dataclass(frozen=True)
class TrainingOptions:
    """Options of a training run.

    Attributes:
        effort: preset for sizes that the options below do not set: "quick" is 500 iterations on 50,000 Gaussians;
            "standard" sizes both, and the keyframes, to the capture; "best" trains with the recipe "long" until
            validation views, held back for a while, show that more training no longer pays.
        iterations: number of training steps, one view each; None for the recipe's, or the effort's.
        time_budget: maximum seconds of the whole command, or, in Python, of `train`; None for no limit. A command plans
            for it, and refuses one that is too short; `train` returns untrained seeds if it is over before the first
            iteration. Learning rates decay by iterations or time, whichever is further along.
        engine: rendering and training engine: "auto" uses a GPU if there is one, else the CPU; "webgpu" accepts
            software adapters too.
        prior: initial points: "dense" computes depth maps; "sparse" uses the points of matched features; "colmap" the
            capture's own sparse cloud, or one that COLMAP triangulates; "none" the capture's own points and poses, or
            random points if it has none; None for the recipe's.
        bundle: refine poses where the photographs contradict them.
        seeds: discs on the surface, or balls; None for the recipe's.
        source_views: source views per keyframe.
        max_keyframes: maximum number of keyframes; None for the effort's.
        exposure: compensate exposure differences of the training photographs: "auto" does so if similar views differ.
        colours: learn an affine colour transform for each training photograph beside the scene.
        transients: "mask" masks things that other photographs do not show, such as people who walk by, in the loss;
            "keep" trains on all pixels.
        recipe: loss, learning rates and their schedule: "pocketgs" for hundreds of iterations; "long" trains until
            more steps no longer pay; "3dgs-7k" and "3dgs-30k" are 3DGS's; "reference" has 3DGS's rates, in a run of any
            length; None for the effort's.
        strategy: how the number of Gaussians changes: "fixed" keeps it; "adc" clones, splits and prunes as 3DGS does;
            "mcmc" relocates transparent Gaussians; "budgeted" grows where the training views have errors; None for the
            recipe's.
        seed: random seed.
        max_gaussians: maximum number of Gaussians; None for the recipe's, or the effort's; smaller if budgets require
            it.
        sh_degree: degree of the spherical harmonics; None for the recipe's.
        threads: CPU threads; None for all cores.
        gpu: part of the name of the GPU to use; None for the best.
        precision: how projected splats and the replay cache are stored on the GPU.
        replay: whether the GPU's backward pass recomputes the forward pass, or reads a cache.
        accumulation: whether gradients on the GPU are summed in order, or atomically in less memory.
        portable: use only features that every WebGPU device has.
        max_memory: megabytes for the process, and megabytes for buffers on the GPU. To stay within it, a command uses
            smaller photographs, unless --downscale is given, or fewer Gaussians.
        evaluate_every: iterations between evaluations on at most 12 of the held-out views; 0 for none until the end,
            when all of them are evaluated.
    """

    effort: Effort = "standard"
    iterations: int | None = None
    time_budget: float | None = None
    engine: EngineName = "auto"
    prior: Prior | None = None
    bundle: bool = True
    seeds: Seeds | None = None
    source_views: int = 4
    max_keyframes: int | None = None
    exposure: Exposure = "auto"
    colours: Colours = "off"
    transients: Literal["mask", "keep"] = "mask"
    recipe: RecipeName | None = None
    strategy: StrategyName | None = None
    seed: int = 0
    max_gaussians: int | None = None
    sh_degree: int | None = None
    threads: int | None = None
    gpu: str | None = None
    precision: Precision = "f32"
    replay: Replay = "recompute"
    accumulation: Accumulation = "ordered"
    portable: bool = False
    max_memory: int = 3000
    evaluate_every: int = 100

    def __post_init__(self) -> None:
        if self.recipe is not None:
            recipe_named(self.recipe)
        _ = self.engine_options  # the engine's options are checked where they are defined
        checks = {
            "effort": (self.effort in get_args(Effort), "quick, standard or best"),
            "iterations": (self.iterations is None or self.iterations >= 1, "at least 1"),
            "time budget": (self.time_budget is None or 0 < self.time_budget < math.inf, "seconds above 0"),
            "prior": (self.prior in (None, *get_args(Prior)), "dense, sparse, colmap or none"),
            "seeds": (self.seeds in (None, *get_args(Seeds)), "discs or balls"),
            "strategy": (self.strategy in (None, *STRATEGIES), "fixed, adc, mcmc or budgeted"),
            "source views": (self.source_views >= 1, "at least 1"),
            "max keyframes": (self.max_keyframes is None or self.max_keyframes >= 2, "at least 2"),
            "exposure": (self.exposure in get_args(Exposure), "auto, on or off"),
            "colours": (self.colours in COLOURS, "on or off"),
            "transients": (self.transients in ("mask", "keep"), "mask or keep"),
            "max gaussians": (self.max_gaussians is None or self.max_gaussians >= 4, "at least 4"),
            "SH degree": (self.sh_degree in (None, 0, 1, 2, 3), "0, 1, 2 or 3"),
            "evaluate every": (self.evaluate_every >= 0, "at least 0"),
            "seed": (self.seed >= 0, "at least 0"),
        }
        for what, (sound, expected) in checks.items():
            if not sound:
                raise PocketGSError(
                    f"{what}: found {getattr(self, what.lower().replace(' ', '_'))}, expected {expected}"
                )

    @property
    def engine_options(self) -> EngineOptions:
        """The options of the engine."""
        return EngineOptions(
            self.engine,
            self.threads,
            self.gpu,
            self.precision,
            self.replay,
            self.accumulation,
            self.portable,
            self.max_memory,
        )


@dataclass(frozen=True)
class SizedOptions(TrainingOptions):
    """Training options with the sizes of the run set: see `pocketgs.training.planning.effort.sized`.

    Attributes:
        open_ended: whether the run ends when it stops paying, after `least_iterations` to `iterations`.
        least_iterations: iterations of a run of the same effort that is not open-ended.
        usual_iterations: of the run if the user sets none, at most those of an open-ended one.
        expected_iterations: that a time budget is expected to allow, which rates and strategies may depend on; None if
            unknown.
    """

    iterations: int = 500
    max_keyframes: int = 40
    max_gaussians: int = 50_000
    prior: Prior = "dense"
    seeds: Seeds = "discs"
    recipe: RecipeName = "pocketgs"
    strategy: StrategyName = "fixed"
    open_ended: bool = False
    least_iterations: int = 500
    usual_iterations: int = 500
    expected_iterations: int | None = None

    @property
    def most_at_start(self) -> int:
        """Maximum number of Gaussians at the start."""
        return most_at_start(self.strategy, self.max_gaussians, self.open_ended)
