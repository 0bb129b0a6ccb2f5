"""Atomic folder writes beside writers of folders with similar names."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from pocketgs.errors import PocketGSError
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


def test_a_mount_point_is_refused_before_the_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    volume = tmp_path / "volume"
    volume.mkdir()
    monkeypatch.setattr(os.path, "ismount", lambda path: Path(path) == volume)
    message = r"volume: is a mount point.* expected a folder in it, such as .*volume/"
    with pytest.raises(PocketGSError, match=message), replacing_folder(volume):
        pytest.fail("work is done in vain")
    assert list(tmp_path.iterdir()) == [volume]
    with replacing_folder(volume / "capture") as (staging, _):
        (staging / "a.txt").touch()
    assert (volume / "capture" / "a.txt").is_file()


@pytest.mark.parametrize("existed", [False, True])
def test_content_that_cannot_be_moved_to_its_place_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, existed: bool
) -> None:
    folder, replace = tmp_path / "scan", os.replace
    if existed:
        folder.mkdir()
        (folder / "a.txt").write_text("earlier")

    def busy(source: Path, target: Path) -> None:
        if folder in (source, target) and Path(source).name != OLD:
            raise OSError(errno.EBUSY, "Device or resource busy")
        replace(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", busy)
        message = r"scan: cannot be written \(Device or resource busy\)"
        with pytest.raises(PocketGSError, match=message) as refused, replacing_folder(folder) as (staging, _):
            (staging / "a.txt").write_text("hours of work")
    kept = Path(str(refused.value).rpartition("the new content is in ")[2])
    assert (kept / "a.txt").read_text() == "hours of work"
    assert sorted(tmp_path.iterdir()) == [*([folder] if existed else []), kept]
    assert not existed or (folder / "a.txt").read_text() == "earlier"
    with replacing_folder(folder):
        pass
    assert (kept / "a.txt").is_file()
