"""Symbolic links that lead out of a capture are refused, whichever of its files they stand for, and whenever."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from capture.phone_layouts import write_polycam, write_record3d, write_stray_scanner
from pocketgs.capture import Capture, open_capture
from pocketgs.capture.colmap_export import export_capture
from pocketgs.capture.open import list_capture
from pocketgs.errors import PocketGSError

OUTSIDE = "outside the capture's folder"


def write_llff(capture: Capture, folder: Path) -> None:
    """Poses and images, as LLFF has them."""
    export_capture(folder, capture)
    shutil.rmtree(folder / "sparse")
    rows = []
    for frame in sorted(capture.frames, key=lambda frame: frame.name):
        to_world = frame.camera.camera_to_world
        right, down, forward, centre = to_world[:3, 0], to_world[:3, 1], to_world[:3, 2], to_world[:3, 3]
        size = [frame.camera.height, frame.camera.width, frame.camera.fx]
        rows.append([*np.stack([down, right, -forward, centre, size], axis=1).ravel(), 1.0, 2.0])
    np.save(folder / "poses_bounds.npy", np.array(rows))


WRITERS: dict[str, Callable[[Capture, Path], None]] = {
    "colmap": lambda capture, folder: export_capture(folder, capture),
    "llff": write_llff,
    "polycam": write_polycam,
    "record3d": write_record3d,
    "stray": write_stray_scanner,
}


def link_out(path: Path, outside: Path) -> None:
    """Move a file or folder out and leave a link to it."""
    outside.mkdir(exist_ok=True)
    target = outside / path.name
    shutil.move(path, target)
    try:
        path.symlink_to(target, target_is_directory=target.is_dir())
    except OSError as error:
        pytest.skip(f"no links here: {error}")


def files_of(folder: Path) -> list[Path]:
    """One file of each kind and folder, and the folders."""
    by_kind = {(path.parent, path.suffix): path for path in sorted(folder.rglob("*")) if path.is_file()}
    return [*by_kind.values(), *(path for path in sorted(folder.rglob("*")) if path.is_dir())]


@pytest.mark.parametrize("name", WRITERS)
def test_no_file_of_a_capture_may_lead_out(small_capture: Capture, tmp_path: Path, name: str) -> None:
    WRITERS[name](small_capture, tmp_path / "original")
    original = open_capture(tmp_path / "original")
    relative = [path.relative_to(tmp_path / "original") for path in files_of(tmp_path / "original")]
    for number, path in enumerate(relative):
        folder = Path(shutil.copytree(tmp_path / "original", tmp_path / str(number)))
        link_out(folder / path, tmp_path / f"outside {number}")
        with pytest.raises(PocketGSError, match=OUTSIDE):
            open_capture(folder)
        if not (folder / path).is_dir():
            (folder / path).unlink()
            shutil.move(tmp_path / f"outside {number}" / path.name, folder / path)
            assert len(open_capture(folder).frames) == len(original.frames)


@pytest.mark.parametrize("name", ["transforms.json", "cloud.ply", "images"])
def test_no_file_of_a_transforms_capture_may_lead_out(capture_folder: Path, tmp_path: Path, name: str) -> None:
    link_out(capture_folder / name, tmp_path / "outside")
    with pytest.raises(PocketGSError, match=OUTSIDE):
        open_capture(capture_folder)


def test_what_is_swapped_for_a_link_later_is_refused(capture_folder: Path, tmp_path: Path) -> None:
    listed = list_capture(capture_folder)
    listed.outline()
    link_out(sorted((capture_folder / "images").iterdir())[3], tmp_path / "outside")
    with pytest.raises(PocketGSError, match=OUTSIDE):
        listed.load()


def test_links_inside_a_capture_and_to_it_are_followed(capture_folder: Path, tmp_path: Path) -> None:
    image = min((capture_folder / "images").iterdir())
    try:
        image.rename(capture_folder / "elsewhere.png")
        image.symlink_to(capture_folder / "elsewhere.png")
        (tmp_path / "link").symlink_to(capture_folder, target_is_directory=True)
    except OSError as error:
        pytest.skip(f"no links here: {error}")
    assert len(open_capture(tmp_path / "link").frames) == 8
