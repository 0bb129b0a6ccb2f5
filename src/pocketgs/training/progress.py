"""The progress reported after each training iteration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pocketgs.scene.gaussians import Gaussians
from pocketgs.system.interrupt import Interrupt
from pocketgs.training.result import Checkpoint

MAX_EVALUATED = 12
"""Maximum number of held-out views whose PSNR is measured during training: of a thousand photographs, rendering every
eighth would take nearly as long as training."""


@dataclass(frozen=True)
class Progress:
    """State passed to an observer after an iteration.

    Attributes:
        iteration: iterations done.
        iterations: end of the run, as far as it is known.
        fraction: progress from 0 to 1, by iterations or by time.
        loss: mean training loss over the last epoch, updated at intervals.
        held_out_psnr: PSNR of the last evaluation on at most `MAX_EVALUATED` held-out views, or None.
        iteration_rate: iterations per second.
        seconds_left: estimate of the time until iterations or the time budget run out.
        gain_per_minute: gain in dB per minute on validation views, or None without any.
        gaussians: current number.
        interrupt: lets an observer request a stop after this iteration, like Ctrl-C, and tells whether one was
            requested, so that a waiting observer can stop waiting.
        scene: returns a copy of the current Gaussians.
        checkpoint: returns a copy of the current state, which is larger.
    """

    iteration: int
    iterations: int
    fraction: float
    loss: float
    held_out_psnr: float | None
    iteration_rate: float
    seconds_left: float
    gain_per_minute: float | None
    gaussians: int
    interrupt: Interrupt
    scene: Callable[[], Gaussians]
    checkpoint: Callable[[], Checkpoint]


Observer = Callable[[Progress], None]
