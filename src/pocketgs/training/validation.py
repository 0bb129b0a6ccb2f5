"""Validation views: training views held back for a while, to measure the gain of more training."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.capture.even_choice import evenly_chosen
from pocketgs.metrics.evaluation import psnr
from pocketgs.scene.background import Background
from pocketgs.splat.engine import Engine
from pocketgs.splat.rendering import render_frame

EVERY, FIRST = 8, 4
"""Every eighth training view, starting with the fifth, is a validation view."""

MIN_VIEWS, MAX_VIEWS = 2, 12
"""Minimum and maximum number of validation views: fewer are unreliable, more only take time."""


@dataclass(frozen=True)
class ValidationSample:
    """One evaluation on the validation views.

    Attributes:
        iteration: steps done.
        psnr: mean PSNR over the validation views, in dB.
        gaussians: number of Gaussians.
        seconds: of training until then.
    """

    iteration: int
    psnr: float
    gaussians: int
    seconds: float


@dataclass(frozen=True)
class ValidationHistory:
    """The history of an open-ended run, which determines all its decisions.

    Attributes:
        samples: evaluations on the validation views, in order.
        decays_from: iteration at which the final decay of the learning rates starts, or None if undecided.
    """

    samples: tuple[ValidationSample, ...] = ()
    decays_from: int | None = None

    def with_sample(self, sample: ValidationSample) -> ValidationHistory:
        """Add an evaluation."""
        return replace(self, samples=(*self.samples, sample))

    @property
    def gain(self) -> float | None:
        """Gain of the last stage in dB, or None before the second evaluation."""
        return self.samples[-1].psnr - self.samples[-2].psnr if len(self.samples) >= 2 else None

    @property
    def gain_per_minute(self) -> float | None:
        """Gain of the last stage in dB per minute; None before there is one, and during the final decay."""
        if self.gain is None or self.decays_from is not None:
            return None
        seconds = self.samples[-1].seconds - self.samples[-2].seconds
        return 60.0 * self.gain / seconds if seconds > 0 else None


def validation_views(views: int) -> list[int]:
    """Indices of the training views to hold back; empty if there are too few training views."""
    found = range(FIRST, views, EVERY)
    if len(found) < MIN_VIEWS:
        return []
    return [found[place] for place in evenly_chosen(len(found), MAX_VIEWS)]


def validation_views_of_few(views: int) -> list[int]:
    """Indices of two training views to hold back where some were dropped since enough were listed; empty below six."""
    return [views // 3, 2 * views // 3] if views // 2 > MIN_VIEWS else []


def mean_psnr(engine: Engine, frames: Sequence[Frame], background: Background) -> float:
    """Mean PSNR of renderings of these views, in dB; NaN if the scene has diverged."""
    values = []
    for frame in frames:
        image = render_frame(engine, frame, background)
        if not np.isfinite(image).all():
            return float("nan")
        values.append(psnr(image, frame.image / 255.0, frame.mask))
    return float(np.mean(values))
