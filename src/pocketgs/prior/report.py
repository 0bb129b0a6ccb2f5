"""What the geometry prior found, for people and for `run.json`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pocketgs.capture.capture import Capture
from pocketgs.prior.keyframes import Decision
from pocketgs.prior.structure import Structure

MAX_NAMES = 8
"""Names that a warning lists."""


@dataclass(frozen=True)
class Poses:
    """What became of the given poses: names of frames.

    Attributes:
        carried: see too little to be refined, and moved with the nearest frame that was.
        replaced: have wrong poses and were placed anew.
        left_out: have wrong poses, could not be placed, and take no part in training.
        doubtful: held-out ones like that: what they are compared with is rendered from the wrong place.
    """

    carried: tuple[str, ...] = ()
    replaced: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    doubtful: tuple[str, ...] = ()

    @classmethod
    def of(cls, structure: Structure | None, capture: Capture) -> Poses:
        """What the structure tells, and which of the frames in doubt the capture holds out."""
        if structure is None:
            return cls()
        held_out = {frame.name for frame in capture.held_out}
        return cls(
            carried=structure.carried,
            replaced=structure.replaced,
            left_out=tuple(name for name in structure.doubtful if name not in held_out),
            doubtful=tuple(name for name in structure.doubtful if name in held_out),
        )

    def warnings(self) -> tuple[str, ...]:
        """What the user should know, in words."""
        said = (
            (self.carried, "see too little to be placed exactly and follow their neighbours"),
            (self.replaced, "had poses that the other photographs contradict and were placed anew"),
            (self.left_out, "have poses that the other photographs contradict and are left out of training"),
            (
                self.doubtful,
                "are held out and have poses that the other photographs contradict: mind their figures",
            ),
        )
        return tuple(f"{len(names)} frames {words}: {_listed(names)}" for names, words in said if names)


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:MAX_NAMES]) + (", ..." if len(names) > MAX_NAMES else "")


@dataclass(frozen=True)
class PriorReport:
    """What the prior found.

    Attributes:
        decisions: which frames are keyframes, one decision per training frame.
        sparse_points: number of triangulated points.
        rmse_given, rmse: root mean square reprojection error in pixels with the given poses and with those used; None
            without sparse points.
        poses_refined: whether poses were changed.
        poses: which frames' poses were wrong or could not be refined.
        gains: least and greatest exposure, if they were compensated.
        points: number of points of the cloud.
        coverage: share of the training pixels that the cloud covers, or None where no depth was computed.
        coverage_known: share that points of known depth cover; the rest is guessed from its surroundings.
        guessed: number of guessed points.
        warnings: what the user should know.
    """

    decisions: list[Decision]
    sparse_points: int
    rmse_given: float | None
    rmse: float | None
    poses_refined: bool
    poses: Poses
    gains: tuple[float, float] | None
    points: int
    coverage: float | None
    coverage_known: float | None
    guessed: int
    warnings: tuple[str, ...]

    @property
    def keyframes(self) -> int:
        """Their number."""
        return sum(decision.kept for decision in self.decisions)
