"""Atomic folder writes beside writers of folders with similar names."""

from __future__ import annotations

from pathlib import Path

import pytest

from pocketgs.files.atomic_folder import OLD, replacing_folder

HALF_SWAPPED = ".scan.v2.0a1b2c3_.partial"
"""What a killed writer of `scan.v2` leaves after it has moved the earlier content aside."""


def test_writers_of_similar_names_leave_each_other_alone(tmp_path: Path) -> None:
    with replacing_folder(tmp_path / "scan.v2") as (staging, _):
        (staging / "a.txt").write_text("longer")
        with replacing_folder(tmp_path / "scan") as (other, _):
            (other / "a.txt").write_text("shorter")
    assert (tmp_path / "scan.v2" / "a.txt").read_text() == "longer"
    assert (tmp_path / "scan" / "a.txt").read_text() == "shorter"


def test_content_moved_aside_is_kept_for_its_own_folder(tmp_path: Path) -> None:
    aside = tmp_path / HALF_SWAPPED / OLD
    aside.mkdir(parents=True)
    (aside / "a.txt").write_text("only copy")
    with pytest.raises(RuntimeError), replacing_folder(tmp_path / "scan"):
        raise RuntimeError
    assert not (tmp_path / "scan").exists()
    with pytest.raises(RuntimeError), replacing_folder(tmp_path / "scan.v2"):
        raise RuntimeError
    assert (tmp_path / "scan.v2" / "a.txt").read_text() == "only copy"
    assert not (tmp_path / HALF_SWAPPED).exists()
