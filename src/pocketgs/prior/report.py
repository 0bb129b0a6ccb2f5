"""Report of the geometry prior, for users and for `run.json`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pocketgs.capture.capture import Capture
from pocketgs.errors import counted, listed
from pocketgs.prior.keyframes import Decision
from pocketgs.prior.poses.convention import Convention
from pocketgs.prior.poses.structure import Structure

MAX_NAMES = 8
"""Maximum number of names in a warning."""


@dataclass(frozen=True)
class PoseReport:
    """The fate of the given poses, as names of frames.

    Attributes:
        convention: in which all given poses were read, if the photographs fit them only so; else empty.
        carried: see too few points to be refined, and were moved with the nearest refined frame.
        replaced: had wrong poses and were relocalised.
        left_out: have wrong poses, could not be relocalised, and are not used for training.
        unplaced_held_out: the same for held-out frames: their renderings are from the wrong place.
    """

    convention: str = ""
    carried: tuple[str, ...] = ()
    replaced: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    unplaced_held_out: tuple[str, ...] = ()

    @classmethod
    def of(cls, structure: Structure | None, capture: Capture, convention: Convention | None) -> PoseReport:
        """From a structure, which of its unplaced frames the capture holds out, and the convention that was tried."""
        read = str(convention) if convention else ""
        if structure is None:
            return cls(read)
        held_out = {frame.name for frame in capture.held_out}
        return cls(
            convention=read,
            carried=structure.carried,
            replaced=structure.replaced,
            left_out=tuple(name for name in structure.unplaced if name not in held_out),
            unplaced_held_out=tuple(name for name in structure.unplaced if name in held_out),
        )

    @property
    def contradicted(self) -> tuple[str, ...]:
        """All frames whose given poses the other photographs contradict."""
        return self.replaced + self.left_out + self.unplaced_held_out

    def warnings(self) -> tuple[str, ...]:
        """Warnings for the user."""
        contradicted = "that the other photographs contradict"
        said = (
            (
                self.carried,
                "frame sees too few points to be placed exactly and follows its neighbours",
                "frames see too few points to be placed exactly and follow their neighbours",
            ),
            (
                self.replaced,
                f"frame had a pose {contradicted} and was placed anew",
                f"frames had poses {contradicted} and were placed anew",
            ),
            (
                self.left_out,
                f"frame has a pose {contradicted} and is left out of training",
                f"frames have poses {contradicted} and are left out of training",
            ),
            (
                self.unplaced_held_out,
                f"frame is held out and has a pose {contradicted}: do not rely on its figures",
                f"frames are held out and have poses {contradicted}: do not rely on their figures",
            ),
        )
        found = [
            f"{counted(len(names), one, several)}: {listed(names, MAX_NAMES)}" for names, one, several in said if names
        ]
        if self.convention:
            found.insert(0, f"the photographs fit the poses only with {self.convention}: they are read so")
        return tuple(found)


@dataclass(frozen=True)
class PriorReport:
    """The result of the prior.

    Attributes:
        decisions: one keyframe decision per training frame.
        sparse_points: number of triangulated points.
        rmse_given, rmse: root mean square reprojection error in pixels with the given poses and with those used; None
            without sparse points.
        poses_refined: whether poses were changed.
        poses: frames whose poses were wrong or could not be refined.
        gains: (F, 3) exposure of each training photograph in red, green and blue, as a factor on display values whose
            geometric mean is 1, if it was compensated; 1 for those that were cut out, which stay as they are.
        points: number of points of the cloud.
        swept_on: device that computed depth, "cpu" or "webgpu", or None if none was computed.
        coverage: share of the training pixels that the cloud covers, or None if no depth was computed.
        coverage_known: share that points of known depth cover; the rest is interpolated.
        guessed: number of points with interpolated depth.
        warnings: for the user.
    """

    decisions: list[Decision]
    sparse_points: int
    rmse_given: float | None
    rmse: float | None
    poses_refined: bool
    poses: PoseReport
    gains: np.ndarray | None
    points: int
    swept_on: str | None
    coverage: float | None
    coverage_known: float | None
    guessed: int
    warnings: tuple[str, ...]

    @property
    def keyframes(self) -> int:
        """Their number."""
        return sum(decision.kept for decision in self.decisions)
