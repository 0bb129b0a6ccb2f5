"""The `Engine` interface between training and rendering, and the options of engines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, get_args

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.scene.background import BLACK, Background
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.rows import RowChange, Statistics
from pocketgs.splat.settings import StepSettings
from pocketgs.system.device import MemoryNeed

EngineName = Literal["auto", "cpu", "webgpu"]
Precision = Literal["f32", "f16"]
Replay = Literal["recompute", "cache"]
Accumulation = Literal["ordered", "atomic"]

KEPT_LOSSES = 4096
"""Number of latest steps whose losses an engine keeps."""


@dataclass(frozen=True)
class Rendering:
    """A rendered view.

    Attributes:
        image: (H, W, 3) float32 RGB over the background, not clipped at 1.
        alpha: (H, W) float32 coverage in [0, 1].
        depth: (H, W) float32 expected depth, Σ α_i T_i z_i / alpha with z of `Camera.depths`; 0 where alpha is 0. None
            unless requested.
    """

    image: np.ndarray
    alpha: np.ndarray
    depth: np.ndarray | None = None


@dataclass(frozen=True)
class OptimiserState:
    """The optimiser's state, needed besides the Gaussians to resume training.

    Attributes:
        first_moments, second_moments: (N, columns) float32; see `ParameterLayout` for the columns.
        steps: number of steps taken.
        near: near plane, fixed when the scene was first uploaded; None to measure it.
        colours: (V, columns) float32 colour transforms of the photographs, see `pocketgs.splat.colours`; None if none
            were learned.
    """

    first_moments: np.ndarray
    second_moments: np.ndarray
    steps: int
    near: float | None = None
    colours: np.ndarray | None = None


class Renderer(Protocol):
    """Renders one scene."""

    def render(self, camera: Camera, background: Background = BLACK, depth: bool = False) -> Rendering:
        """Render the current scene."""


class Engine(Renderer, Protocol):
    """Renders Gaussians and trains them. It holds all state of a run.

    Only one thread at a time may call an engine.
    """

    name: str
    device: str
    """Name of the device that computes."""

    def prepare(self) -> None:
        """Compile all kernels ahead of the first step."""

    def set_views(self, frames: Sequence[Frame]) -> None:
        """Set the photographs that `step` indexes. Their colour transforms start at the identity."""

    def set_masks(self, masks: Sequence[np.ndarray | None]) -> None:
        """Replace the photographs' masks: (H, W) bool, True for pixels in the loss from the next step on; None for all.

        Raises:
            PocketGSError: the masks do not fit the photographs.
        """

    def upload(self, gaussians: Gaussians, state: OptimiserState | None = None) -> None:
        """Copy the scene, and the optimiser's state; without one, the optimiser is reset.

        Raises:
            PocketGSError: the scene or the state is invalid, or its colour transforms do not fit the photographs.
        """

    def step(self, view: int, settings: StepSettings) -> None:
        """Train on one view: render, compare, differentiate, update. May return before the step is complete."""

    @property
    def count(self) -> int:
        """Number of Gaussians."""

    def change_rows(self, change: RowChange) -> None:
        """Select, duplicate and set Gaussians, including the optimiser's rows. Statistics restart at zero.

        Raises:
            PocketGSError: the change does not fit the scene, or the result does not fit into memory.
        """

    def statistics(self) -> Statistics:
        """Sums over the steps with `StepSettings.statistics` since the last change of rows or restart."""

    def restart_statistics(self, start: Statistics | None = None) -> None:
        """Restart the statistics at zero, or from earlier sums."""

    def loss(self, steps: int = 1) -> float:
        """Mean loss of the last `steps` steps since the upload, at most KEPT_LOSSES, each before its update. NaN before
        the first. Waits for them.
        """

    def download(self) -> Gaussians:
        """Copy the current scene."""

    def optimiser_state(self) -> OptimiserState:
        """Copy the optimiser's state."""

    def memory(self) -> dict[str, int]:
        """Bytes that the engine holds, by purpose."""

    def memory_needed(self, gaussians: int, coefficients: int, photographs: Sequence[tuple[int, int]]) -> MemoryNeed:
        """Estimate the memory needed for training, before anything is uploaded.

        Args:
            gaussians: number of Gaussians.
            coefficients: spherical-harmonics coefficients per channel.
            photographs: width and height of each.

        Raises:
            PocketGSError: it exceeds the device's memory.
        """


@dataclass(frozen=True)
class EngineOptions:
    """Choice and settings of an engine.

    Attributes:
        engine: "auto" uses a GPU if there is one, else the CPU; "webgpu" accepts software adapters too.
        threads: maximum number of CPU threads, or None for one per core.
        gpu: part of the name of the GPU to use, not with engine "cpu"; None for the best.
        precision: how projected splats and the replay cache are stored on the GPU.
        replay: whether the GPU's backward pass recomputes the forward pass's values, or reads them from a cache.
        accumulation: how gradients of a GPU's tiles are summed: "ordered" gives the same bits every time; "atomic"
            takes less memory, on GPUs with atomic addition of floats.
        portable: use only features that every WebGPU device has.
        max_memory: maximum megabytes of the engine's GPU memory, and, in a command, of the memory for reading.

    Raises:
        PocketGSError: a setting is unknown or a number is out of range.
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
        check_threads(self.threads)
        if self.max_memory < 1:
            raise PocketGSError(f"max memory: found {self.max_memory}, expected at least 1")
        for name, choices in (("precision", Precision), ("replay", Replay), ("accumulation", Accumulation)):
            if getattr(self, name) not in get_args(choices):
                raise PocketGSError(f"{name}: found {getattr(self, name)!r}, expected {' or '.join(get_args(choices))}")


def check_threads(threads: int | None) -> None:
    """Refuse a number of threads below 1; None stands for one per core.

    Raises:
        PocketGSError: it is.
    """
    if threads is not None and threads < 1:
        raise PocketGSError(f"threads: found {threads}, expected at least 1")
