"""Photographs that cannot be decoded are left out, with a warning, as missing ones are."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from pocketgs.capture import open_capture
from pocketgs.capture.open import list_capture
from pocketgs.errors import PocketGSError


def cut(path: Path, keep: int) -> None:
    path.write_bytes(path.read_bytes()[:keep])


def photographs(folder: Path) -> list[Path]:
    return sorted((folder / "images").iterdir())


def test_they_are_left_out(capture_folder: Path) -> None:
    """One without a header, which plans read, one that ends early, and one of those held out."""
    names = [frame.name for frame in open_capture(capture_folder).frames]
    for index, keep in ((0, 600), (2, 0), (5, 600)):
        cut(photographs(capture_folder)[index], keep)
    listed = list_capture(capture_folder)
    assert len(listed.outline().training) + len(listed.outline().held_out) == len(names) - 1
    capture = listed.load()
    left = {f"images/{photographs(capture_folder)[index].name}" for index in (0, 2, 5)}
    assert sorted(frame.name for frame in capture.frames) == sorted(set(names) - left)
    [warning] = capture.warnings
    assert warning.startswith(f"3 of {len(names)} photographs cannot be decoded, the first {min(left)}: ")
    assert str(capture_folder / min(left)) in warning
    assert capture.photographs is not None
    assert sorted(capture.photographs.map(lambda frame: None, 20)) == sorted(frame.name for frame in capture.frames)


def test_something_must_be_left(capture_folder: Path) -> None:
    for path in photographs(capture_folder):
        cut(path, 600)
    with pytest.raises(PocketGSError, match=r"8 of 8 photographs cannot be decoded, .* no frame is left to train on"):
        open_capture(capture_folder)
    for path in photographs(capture_folder):
        cut(path, 0)
    with pytest.raises(PocketGSError, match=r"0001\.png: cannot be decoded"):
        open_capture(capture_folder)


def test_named_masks_are_not_left_out(capture_folder: Path, tmp_path: Path) -> None:
    masks = tmp_path / "named"
    masks.mkdir()
    for path in photographs(capture_folder):
        (masks / path.name).write_bytes(path.read_bytes())
    cut(masks / photographs(capture_folder)[3].name, 600)
    with pytest.raises(PocketGSError, match=r"named/0003\.png: cannot be decoded"):
        open_capture(capture_folder, masks=str(masks))


@pytest.mark.parametrize("app", ["polycam", "record3d", "3d-scanner-app", "nerfstudio"])
def test_of_phone_apps(copied_phone: Callable[[str], Path], app: str) -> None:
    folder = copied_phone(app)
    whole = open_capture(folder)
    photograph = folder / whole.train[1].name
    cut(photograph, photograph.stat().st_size // 2)
    capture = open_capture(folder)
    assert [frame.name for frame in capture.train] == [f.name for f in whole.train if f.name != whole.train[1].name]
    assert "1 of 8 photographs cannot be decoded" in " ".join(capture.warnings)
