"""The seam between training and the code that renders and differentiates: what an engine is, and how one is chosen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, get_args

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.rows import RowChange, Statistics
from pocketgs.splat.settings import StepSettings
from pocketgs.system.memory_need import MemoryNeed

EngineName = Literal["auto", "cpu", "webgpu"]
Precision = Literal["f32", "f16"]
Replay = Literal["recompute", "cache"]
Accumulation = Literal["ordered", "atomic"]

ENGINES = get_args(EngineName)

KEPT_LOSSES = 4096
"""An engine remembers the losses of so many of the latest steps."""


@dataclass(frozen=True)
class Rendering:
    """What a camera sees of the scene.

    Attributes:
        image: (H, W, 3) float32 RGB over the background, not cut off above 1.
        alpha: (H, W) float32 coverage in [0, 1].
        depth: (H, W) float32 expected depth along the optical axis, Σ α_i T_i z_i / alpha; 0 where alpha is 0. None
            unless asked for.
    """

    image: np.ndarray
    alpha: np.ndarray
    depth: np.ndarray | None = None


@dataclass(frozen=True)
class OptimiserState:
    """Adam's memory: what training needs besides the Gaussians to go on where it stopped.

    Attributes:
        first_moments, second_moments: (N, columns) float32, columns as `ParameterLayout` has them.
        steps: steps taken.
        near: least depth of what is drawn, which stays what it was when the scene was first given; None to measure it.
        colours: (V, columns) float32, the photographs' colour transforms as `pocketgs.splat.colours` has them; None
            where none was learned.
    """

    first_moments: np.ndarray
    second_moments: np.ndarray
    steps: int
    near: float | None = None
    colours: np.ndarray | None = None


class Renderer(Protocol):
    """Renders one scene."""

    def render(
        self, camera: Camera, background: tuple[float, float, float] = (0.0, 0.0, 0.0), depth: bool = False
    ) -> Rendering:
        """Render the scene as it stands."""


class Engine(Renderer, Protocol):
    """Renders Gaussians and trains them. All state of a run lives behind this seam.

    One thread at a time may call an engine.
    """

    name: str
    device: str
    """What it computes on, in words."""

    def prepare(self) -> None:
        """Compile whatever has to be compiled, so that no step has to."""

    def set_views(self, frames: Sequence[Frame]) -> None:
        """Take the photographs that `step` refers to by index. Their colour transforms start at the identity."""

    def set_masks(self, masks: Sequence[np.ndarray | None]) -> None:
        """Replace the photographs' masks: (H, W) bool, true for pixels that count from the next step on; None for all.

        Raises:
            PocketGSError: the masks are not of these photographs.
        """

    def upload(self, gaussians: Gaussians, state: OptimiserState | None = None) -> None:
        """Take a copy of the scene, and of the optimiser's state or start it anew.

        Raises:
            PocketGSError: the scene or the state cannot be used, or its colours are not of the photographs.
        """

    def step(self, view: int, settings: StepSettings) -> None:
        """Train on one view: render, compare, differentiate, update. May return before it is done."""

    @property
    def count(self) -> int:
        """Number of Gaussians."""

    def change_rows(self, change: RowChange) -> None:
        """Select, duplicate and set Gaussians, the optimiser's rows with them. Statistics start anew.

        Raises:
            PocketGSError: the change is not of this scene, or memory does not hold what comes of it.
        """

    def statistics(self) -> Statistics:
        """What steps with `StepSettings.statistics` have summed up since the last change of rows or start."""

    def restart_statistics(self, start: Statistics | None = None) -> None:
        """Sum up from zero, or from sums that were taken before."""

    def loss(self, steps: int = 1) -> float:
        """Mean loss of the last `steps` steps, at most KEPT_LOSSES, measured before their updates. Waits for them."""

    def download(self) -> Gaussians:
        """A copy of the scene as it stands."""

    def optimiser_state(self) -> OptimiserState:
        """A copy of the optimiser's state."""

    def memory(self) -> dict[str, int]:
        """Bytes that the engine holds, by the name of what they are for."""

    def memory_needed(self, gaussians: int, coefficients: int, photographs: Sequence[tuple[int, int]]) -> MemoryNeed:
        """What training would take, before anything is given to the engine.

        Args:
            gaussians: their number.
            coefficients: of spherical harmonics a channel.
            photographs: width and height of each.

        Raises:
            PocketGSError: its memory does not hold it.
        """


@dataclass(frozen=True)
class EngineOptions:
    """Which engine, and how it works.

    Attributes:
        engine: "auto" takes a GPU where there is one, else the CPU; "webgpu" takes software adapters too.
        threads: CPU threads that it may use, or None for one a core.
        gpu: part of the name of the GPU to use, or None for the best.
        precision: of projected splats and of the replay cache on the GPU.
        replay: how the GPU's backward pass comes by what the forward pass computed: it recomputes it, or keeps it in a
            cache.
        accumulation: how the gradients of a GPU's tiles come together: "ordered" gives the same bits every time;
            "atomic" takes less memory, on GPUs that can add floats atomically.
        portable: use only what every GPU with WebGPU has.
        max_memory: megabytes of GPU memory that the engine may take, and, in a command, that reading may.

    Raises:
        PocketGSError: a number is none that there can be of what it counts.
    """

    engine: EngineName = "auto"
    threads: int | None = None
    gpu: str | None = None
    precision: Precision = "f32"
    replay: Replay = "recompute"
    accumulation: Accumulation = "ordered"
    portable: bool = False
    max_memory: int = 3000

    def __post_init__(self) -> None:
        if self.threads is not None and self.threads < 1:
            raise PocketGSError(f"threads: found {self.threads}, expected at least 1")
        if self.max_memory < 1:
            raise PocketGSError(f"max memory: found {self.max_memory}, expected at least 1")


def create_engine(options: EngineOptions | None = None) -> Engine:
    """Make an engine.

    Args:
        options: which; all at their defaults if None.

    Raises:
        PocketGSError: the engine is not available here.
    """
    options = options or EngineOptions()
    if chosen_engine(options) == "webgpu":
        from pocketgs.splat.webgpu.engine import WebGpuEngine

        return WebGpuEngine(options)
    from pocketgs.splat.cpu.engine import CpuEngine

    return CpuEngine(options.threads)


def chosen_engine(options: EngineOptions) -> Literal["cpu", "webgpu"]:
    """Which engine "auto" stands for here, or the one that is named.

    Raises:
        PocketGSError: its name is not known.
    """
    if options.engine not in ENGINES:
        raise PocketGSError(f"engine {options.engine!r}: not known, expected one of {', '.join(ENGINES)}")
    return "webgpu" if options.engine == "webgpu" or (options.engine == "auto" and _has_gpu()) else "cpu"


def _has_gpu() -> bool:
    from pocketgs.gpu.adapters import has_gpu

    return has_gpu()
