"""The seam between training and the code that renders and differentiates: what an engine is, and how one is chosen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from pocketgs.camera import Camera
from pocketgs.capture.capture import Frame
from pocketgs.errors import PocketGSError
from pocketgs.gaussians import Gaussians
from pocketgs.splat.settings import StepSettings

EngineName = Literal["auto", "cpu", "webgpu"]


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
        first_moments, second_moments: (N, 10 + 3 K) float32; columns: mean 3, log scale 3, rotation 3, opacity logit 1,
            SH coefficients K x RGB.
        steps: steps taken.
    """

    first_moments: np.ndarray
    second_moments: np.ndarray
    steps: int


class Engine(Protocol):
    """Renders Gaussians and trains them. All state of a run lives behind this seam.

    One thread at a time may call an engine.
    """

    name: str

    def prepare(self) -> None:
        """Compile whatever has to be compiled, so that no step has to."""

    def set_views(self, frames: Sequence[Frame]) -> None:
        """Take the photographs that `step` refers to by index."""

    def upload(self, gaussians: Gaussians, state: OptimiserState | None = None) -> None:
        """Take a copy of the scene, and of the optimiser's state or start it anew."""

    def step(self, view: int, settings: StepSettings) -> None:
        """Train on one view: render, compare, differentiate, update. Returns without waiting for the result."""

    def loss(self) -> float:
        """The loss of the last step, measured before its update."""

    def render(
        self, camera: Camera, background: tuple[float, float, float] = (0.0, 0.0, 0.0), depth: bool = False
    ) -> Rendering:
        """Render the scene as it stands."""

    def download(self) -> Gaussians:
        """A copy of the scene as it stands."""

    def optimiser_state(self) -> OptimiserState:
        """A copy of the optimiser's state."""

    def memory(self) -> dict[str, int]:
        """Bytes that the engine holds, by the name of what they are for."""


def create_engine(name: EngineName = "auto", threads: int | None = None) -> Engine:
    """Make an engine; `auto` takes the best that this device has.

    Args:
        name: which.
        threads: CPU threads that it may use, or None for one a core.

    Raises:
        PocketGSError: the engine is not available here.
    """
    if name in ("auto", "cpu"):
        from pocketgs.splat.cpu.engine import CpuEngine

        return CpuEngine(threads)
    raise PocketGSError(f"engine {name!r} is not available in this version, expected auto or cpu")
