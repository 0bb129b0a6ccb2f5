"""What the geometry prior found, for people and for `run.json`."""

from __future__ import annotations

from dataclasses import dataclass

from pocketgs.prior.keyframes import Decision


@dataclass(frozen=True)
class PriorReport:
    """What the prior found.

    Attributes:
        decisions: of the gate, one a training frame.
        sparse_points: number of triangulated points.
        rmse_given, rmse: root mean square reprojection error in pixels with the given poses and with those used; None
            without sparse points.
        poses_refined: whether poses were changed.
        carried: names of frames that see too few points and moved with the nearest keyframe.
        gains: least and greatest exposure, if they were compensated.
        points: number of points of the cloud.
        warnings: what the user should know.
    """

    decisions: list[Decision]
    sparse_points: int
    rmse_given: float | None
    rmse: float | None
    poses_refined: bool
    carried: tuple[str, ...]
    gains: tuple[float, float] | None
    points: int
    warnings: tuple[str, ...]
