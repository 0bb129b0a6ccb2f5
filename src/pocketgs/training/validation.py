"""Validation views: training views that are held back for a while, to see what more training is worth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.metrics.evaluation import psnr
from pocketgs.splat.engine import Engine

EVERY, FIRST = 8, 4
"""Every eighth training view, beginning with the fifth, is a validation view."""

MIN_VIEWS, MAX_VIEWS = 2, 12
"""Fewer say too little; more would not say more, but cost time."""


@dataclass(frozen=True)
class Look:
    """What the validation views said at one moment.

    Attributes:
        iteration: steps done.
        psnr: mean over the validation views, in dB.
        gaussians: their number.
        seconds: of training until then, in the process that looked.
    """

    iteration: int
    psnr: float
    gaussians: int
    seconds: float


@dataclass(frozen=True)
class Course:
    """What an open-ended run has learnt so far. All that it decides follows from this.

    Attributes:
        looks: at the validation views, in order.
        decays_from: iteration from which on learning rates fall to the end, or None as long as that is not decided.
    """

    looks: tuple[Look, ...] = ()
    decays_from: int | None = None

    def with_look(self, look: Look) -> Course:
        """The course with one more look."""
        return replace(self, looks=(*self.looks, look))

    @property
    def gain(self) -> float | None:
        """Decibels that the last stage has won, or None before there were two looks."""
        return self.looks[-1].psnr - self.looks[-2].psnr if len(self.looks) >= 2 else None

    @property
    def gain_per_minute(self) -> float | None:
        """Decibels per minute that the last stage has won; None before there is one, and once rates fall to the end."""
        if self.gain is None or self.decays_from is not None:
            return None
        seconds = self.looks[-1].seconds - self.looks[-2].seconds
        return 60.0 * self.gain / seconds if seconds > 0 else None


def validation_views(views: int) -> list[int]:
    """Indices of the training views to hold back; none where there are too few training views."""
    found = list(range(FIRST, views, EVERY))
    if len(found) < MIN_VIEWS:
        return []
    places = np.linspace(0, len(found) - 1, min(len(found), MAX_VIEWS)).round().astype(int)
    return [found[place] for place in places]


def validation_psnr(engine: Engine, frames: Sequence[Frame], background: tuple[float, float, float]) -> float:
    """Mean PSNR of what the engine renders at these views, in dB."""
    values = []
    for frame in frames:
        image = np.clip(engine.render(frame.camera, background).image, 0.0, 1.0)
        values.append(psnr(image, frame.image / 255.0, frame.mask))
    return float(np.mean(values))
