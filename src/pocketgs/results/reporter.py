"""What a run tells its caller while it works."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pocketgs.capture.capture import Capture
from pocketgs.prior.report import PriorReport
from pocketgs.training.loop import Progress
from pocketgs.training.planning.plan import Plan


@dataclass(frozen=True)
class Reporter:
    """Progress callbacks of a run.

    Attributes:
        on_stage: called with a stage's name when it begins.
        on_capture: called with the capture once it is read.
        on_prior: called with what the geometry prior found.
        on_progress: called after every iteration.
        on_warning: called with what the user should know, in words.
        on_prepared: called with the capture as training sees it: its poses may have been refined.
        on_plan: called with the size that the run is planned at, before a photograph is decoded.
        on_count: told how much of the stage is done, and of how much, where that is known.
    """

    on_stage: Callable[[str], None] = lambda stage: None
    on_capture: Callable[[Capture], None] = lambda capture: None
    on_prior: Callable[[PriorReport], None] = lambda report: None
    on_progress: Callable[[Progress], None] = lambda progress: None
    on_warning: Callable[[str], None] = lambda warning: None
    on_prepared: Callable[[Capture], None] = lambda capture: None
    on_plan: Callable[[Plan], None] = lambda plan: None
    on_count: Callable[[int, int], None] = lambda done, of: None
