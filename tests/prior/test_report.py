"""The prior's report."""

from __future__ import annotations

from pocketgs.prior.report import PoseReport


def test_one_frame_or_several() -> None:
    assert PoseReport().warnings() == ()
    some = PoseReport(carried=("1.jpg",), left_out=("2.jpg", "3.jpg"), unplaced_held_out=("4.jpg",))
    contradicted = "that the other photographs contradict"
    assert some.warnings() == (
        "1 frame sees too few points to be placed exactly and follows its neighbours: 1.jpg",
        f"2 frames have poses {contradicted} and are left out of training: 2.jpg, 3.jpg",
        f"1 frame is held out and has a pose {contradicted}: do not rely on its figures: 4.jpg",
    )
