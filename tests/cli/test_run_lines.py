"""Lines that commands print about runs."""

from __future__ import annotations

import pytest

from pocketgs.cli.run_lines import prior_line
from pocketgs.prior.report import PoseReport, PriorReport


def report(*, rmse: float, refined: bool, convention: str = "") -> PriorReport:
    """A report of 100 sparse points that fit the given poses to 0.5 pixels."""
    return PriorReport(
        decisions=[],
        sparse_points=100,
        rmse_given=0.5,
        rmse=rmse,
        poses_refined=refined,
        poses=PoseReport(convention),
        gains=None,
        points=1000,
        swept_on=None,
        coverage=None,
        coverage_known=None,
        guessed=0,
        warnings=(),
    )


@pytest.mark.parametrize(
    ("given", "line"),
    [
        (report(rmse=0.5, refined=False), "poses as given (reprojection 0.50 px)"),
        (report(rmse=0.25, refined=True), "poses refined (reprojection 0.50 -> 0.25 px)"),
        (
            report(rmse=0.5, refined=True, convention="x"),
            "poses read as the photographs fit them (reprojection 0.50 px)",
        ),
        (report(rmse=0.25, refined=True, convention="x"), "poses refined (reprojection 0.50 -> 0.25 px)"),
    ],
)
def test_what_became_of_the_poses(given: PriorReport, line: str) -> None:
    assert line in prior_line(given)
