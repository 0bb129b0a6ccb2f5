"""Progress callbacks of a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pocketgs.capture.capture import Capture
from pocketgs.prior.report import PriorReport
from pocketgs.training.planning.plan import Plan
from pocketgs.training.progress import Progress


@dataclass(frozen=True)
class Reporter:
    """Progress callbacks of a run.

    Attributes:
        on_stage: called with a stage's name when it begins.
        on_capture: called with the capture after it is read.
        on_prior: called with the report of the geometry prior.
        on_progress: called after every iteration.
        on_warning: called with a warning for the user.
        on_prepared: called with the capture as training uses it: poses may have been refined.
        on_plan: called with the run's plan, before a photograph is decoded.
        on_count: called with the progress of a stage and its total, where known.
    """

    on_stage: Callable[[str], None] = lambda stage: None
    on_capture: Callable[[Capture], None] = lambda capture: None
    on_prior: Callable[[PriorReport], None] = lambda report: None
    on_progress: Callable[[Progress], None] = lambda progress: None
    on_warning: Callable[[str], None] = lambda warning: None
    on_prepared: Callable[[Capture], None] = lambda capture: None
    on_plan: Callable[[Plan], None] = lambda plan: None
    on_count: Callable[[int, int], None] = lambda done, of: None
