"""Time model: the duration of the stages of a run.

Times were measured on two cores of an AMD EPYC (Zen 5); `calibration` measures the factor for this machine. They are
overestimates: time left over goes to training, which stops by the clock.
"""

from __future__ import annotations

from dataclasses import dataclass

from pocketgs.prior.features.detection import MAX_SIDE, PIXELS
from pocketgs.prior.features.pairs import PAIRS_PER_VIEW
from pocketgs.splat.parameters import ParameterLayout
from pocketgs.training.planning.calibration import Speed
from pocketgs.training.planning.work import Work
from pocketgs.training.progress import MAX_EVALUATED

MEGA = 1e6

# Seconds on two cores of the machine of `calibration.STEP_SECONDS`, fitted to the stages' times in `run.json` of runs
# there. `calibration` measures how fast this machine is beside it.
DECODED_MEGAPIXEL, FEATURES_MEGAPIXEL, MATCHED_PAIR = 0.03, 0.2, 0.01
"""Seconds per million pixels of photographs, as stored and as features are detected on, and per pair of views."""

ADJUSTED_VIEW, ADJUSTED_CUBE = 0.1, 1e-7
"""Seconds per view, and per cube of their number: some 30 systems of equations are solved for all cameras at once."""

SWEPT_MEGAPIXEL, SWEPT_MEGAPIXEL_AND_SOURCE = 0.5, 0.25
"""Seconds per million pixels of keyframes, and as many again for each source view."""

MERGED_MILLION, HULL_MILLION_AND_VIEW, SEEDED_MILLION = 0.6, 0.2, 5.0
"""Seconds per million candidate points to merge, per million and view to check against alpha; per million Gaussians."""

STEP_MILLION, STEP_MILLION_COLUMNS, STEP_MEGAPIXEL = 0.3, 0.003, 0.07
"""Seconds of a step per million Gaussians, per million of their parameters, and per million pixels."""

LOOK_VIEW, LOOK_MEGAPIXEL = 0.005, 0.1
"""Seconds per held-out view in evaluations during training."""

EVALUATED_VIEW, EVALUATED_MEGAPIXEL = 0.02, 2.0
"""Seconds per held-out view at the end: rendering, metrics, and writing an image."""

WRITTEN, WRITTEN_MILLION = 0.2, 3.0
"""Seconds to write a result, and per million Gaussians in it."""


@dataclass(frozen=True)
class Timetable:
    """Estimated duration of a run.

    Attributes:
        before: seconds until the first step.
        step: of one step, including its share of the evaluations during training.
        after: seconds from the last step until the result is written.
    """

    before: float
    step: float
    after: float

    def steps_within(self, seconds: float) -> int:
        """Number of steps that fit into the time; 0 if not even the other stages fit."""
        return max(0, int((seconds - self.before - self.after) / self.step))

    def total(self, steps: int) -> float:
        """Duration in seconds of a run with this many steps."""
        return self.before + steps * self.step + self.after


def timetable(work: Work, speed: Speed) -> Timetable:
    """Estimate the duration of a run, from planning on."""
    outline = work.outline
    decoded = outline.stored_pixels * (len(outline.training) + len(outline.held_out)) / MEGA
    prior, sweeps = DECODED_MEGAPIXEL * decoded, 0.0
    if work.has_prior:
        prior += _poses(work)
    if work.has_depth:
        megapixels = work.keyframes * work.sweep_pixels / MEGA
        sweeps = megapixels * (SWEPT_MEGAPIXEL + SWEPT_MEGAPIXEL_AND_SOURCE * work.options.source_views)
        prior += MERGED_MILLION * work.candidates / MEGA
        if outline.has_alpha:
            prior += HULL_MILLION_AND_VIEW * work.candidates / MEGA * len(outline.training)
    millions, megapixels = work.gaussians / MEGA, outline.pixels / MEGA
    seeding = SEEDED_MILLION * millions
    step = step_seconds(work.gaussians, work.coefficients, outline.pixels)
    held_out = len(outline.held_out)
    look = min(held_out, MAX_EVALUATED) * (LOOK_VIEW + LOOK_MEGAPIXEL * megapixels)
    after = WRITTEN + WRITTEN_MILLION * millions + held_out * (EVALUATED_VIEW + EVALUATED_MEGAPIXEL * megapixels)
    looks = look / work.options.evaluate_every if work.options.evaluate_every else 0.0
    return Timetable(
        before=speed.prior * (prior + seeding) + speed.sweeps * sweeps,
        step=speed.training * step + max(speed.prior, speed.training) * looks,
        after=max(speed.prior, speed.training) * after,
    )


def step_seconds(gaussians: int, coefficients: int, pixels: float) -> float:
    """Duration of a step on the machine that the model was measured on.

    Args:
        gaussians: number of Gaussians.
        coefficients: of spherical harmonics per channel.
        pixels: per view.
    """
    columns = ParameterLayout(coefficients).columns
    return (STEP_MILLION + STEP_MILLION_COLUMNS * columns) * gaussians / MEGA + STEP_MEGAPIXEL * pixels / MEGA


def _poses(work: Work) -> float:
    """Seconds for features and matches of all frames, and for bundle adjustment, which is assumed to be needed."""
    outline = work.outline
    views = len(outline.training) + len(outline.held_out)
    looked_at = min(outline.stored_pixels, MAX_SIDE**2, PIXELS / views)
    features = (DECODED_MEGAPIXEL * outline.stored_pixels + FEATURES_MEGAPIXEL * looked_at) / MEGA * views
    pairs = views * min(PAIRS_PER_VIEW, views - 1) / 2
    adjusted = ADJUSTED_VIEW * views + ADJUSTED_CUBE * views**3 if work.options.bundle else 0.0
    return features + MATCHED_PAIR * pairs + adjusted
