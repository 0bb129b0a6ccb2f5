"""Recognising formats, options, splits and the words of the protocol."""

from __future__ import annotations

import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from pocketgs.capture import open_capture
from pocketgs.capture.hold_out import ordinal
from pocketgs.capture.open import lacks_poses, video_of
from pocketgs.errors import PocketGSError


def test_unknown_format_lists_what_was_looked_for(tmp_path):
    with pytest.raises(PocketGSError) as caught:
        open_capture(tmp_path)
    for looked_for in ("transforms_train.json", "transforms.json", "sparse/0", "poses_bounds.npy"):
        assert looked_for in str(caught.value)


def test_what_is_there_is_named(tmp_path):
    (tmp_path / "scan.zip").touch()
    with pytest.raises(PocketGSError, match=r"supported format: it is an archive: unpack it first$"):
        open_capture(tmp_path / "scan.zip")


@pytest.mark.parametrize(("name", "program"), [("cameras.sfm", "Meshroom"), ("house.PSX", "Metashape")])
def test_projects_of_other_programs_are_named(tmp_path, name, program):
    (tmp_path / name).touch()
    for path in (tmp_path, tmp_path / name):
        with pytest.raises(PocketGSError, match=rf"{name} is a project of {program}: export its cameras for COLMAP"):
            open_capture(path)


def test_a_folder_stands_for_the_only_video_in_it(tmp_path, write_transforms):
    video, other = tmp_path / "clip/walk.MOV", tmp_path / "clip/more.mp4"
    video.parent.mkdir()
    video.touch()
    assert video_of(video.parent) == video
    assert video_of(tmp_path) == video
    assert video_of(tmp_path / "absent") == tmp_path / "absent"
    macs = tmp_path / "__MACOSX/._walk.MOV"
    macs.parent.mkdir()
    macs.touch()
    assert video_of(tmp_path) == video
    other.touch()
    assert video_of(video.parent) == video.parent
    assert video_of(tmp_path) == tmp_path
    other.unlink()
    (tmp_path / "another").mkdir()
    (tmp_path / "another/walk.mp4").touch()
    assert video_of(tmp_path) == tmp_path
    recording = write_transforms()
    (recording / "rgb.mp4").touch()
    assert video_of(recording) == recording
    (recording / "transforms.json").unlink()
    assert video_of(recording) == recording  # photographs are meant


def test_a_folder_stands_for_the_only_capture_in_it(tmp_path, write_transforms):
    """There, or a level deeper. Of several, photographs without poses were taken before, or those of a third."""
    outer = tmp_path / "outer"
    folder = outer / "unpacked/scan"
    shutil.copytree(write_transforms(), folder, ignore=shutil.ignore_patterns("outer"))
    [warning] = open_capture(outer).warnings
    assert warning == f"{outer}: not a capture itself, using the one in it, unpacked/scan"
    assert not lacks_poses(outer)
    shutil.copytree(folder, outer / "unpacked/again")
    with pytest.raises(PocketGSError, match=r"outer: holds 2 captures, unpacked/again, unpacked/scan: name"):
        open_capture(outer)
    shutil.copytree(folder, outer / "third")
    assert open_capture(outer).warnings[0].endswith("the one in it, third")
    shutil.copytree(folder, outer / "fourth")
    with pytest.raises(PocketGSError, match=r"outer: holds 2 captures, fourth, third: name one of them"):
        open_capture(outer)
    shutil.copytree(folder / "images", outer / "images")
    assert lacks_poses(outer)  # its own photographs are meant


@pytest.mark.parametrize(("beside", "is_hidden"), [(1, False), (9, False), (10, True), (30, True)])
def test_previews_beside_the_only_capture(tmp_path, write_transforms, beside, is_hidden):
    """As many photographs as it has are meant themselves: a capture may have been made of them."""
    outer = tmp_path / "outer"
    shutil.copytree(write_transforms(), outer / "unpacked/scan", ignore=shutil.ignore_patterns("outer"))
    for number in range(beside):
        Image.new("RGB", (4, 3)).save(outer / f"{number}.jpg")
    assert lacks_poses(outer) == is_hidden
    if not is_hidden:
        assert open_capture(outer).warnings[0].endswith("using the one in it, unpacked/scan")
        shutil.copytree(outer / "unpacked/scan", outer / "unpacked/again")
        with pytest.raises(PocketGSError, match="holds 2 captures, unpacked/again, unpacked/scan: name one of them"):
            open_capture(outer)


def test_a_capture_of_the_photographs_beside_it(tmp_path, write_transforms):
    """It holds none itself, as a model that another program wrote."""
    outer = tmp_path / "outer"
    shutil.copytree(write_transforms() / "images", outer)
    (outer / "model").mkdir()
    stated = (tmp_path / "transforms.json").read_text().replace("images/", "../")
    (outer / "model/transforms.json").write_text(stated)
    assert not lacks_poses(outer)
    assert len(open_capture(outer).frames) == 10


@pytest.mark.parametrize("name", ["absent", "nul\0", "x" * 5000])
def test_paths_that_lead_nowhere(tmp_path, name):
    with pytest.raises(PocketGSError, match=r"no such file|cannot be read"):
        open_capture(tmp_path / name)


@pytest.mark.parametrize(
    "options",
    [
        {"downscale": 0.5},
        {"downscale": float("nan")},
        {"max_size": 0},
        {"hold_out": -1},
        {"hold_out": 1},
        {"background": (0, 0)},
        {"background": (0, 0, 2)},
        {"images": "../elsewhere"},
        {"images": "absent"},
    ],
)
def test_unusable_options(write_transforms, options):
    with pytest.raises(PocketGSError):
        open_capture(write_transforms(), **options)


def test_every_nth_by_name_is_held_out(ring, write_transforms):
    frames = ring.transforms()["frames"][::-1]
    capture = open_capture(write_transforms(frames=frames), hold_out=3)
    assert [frame.name[-6:-4] for frame in capture.held_out] == ["09", "06", "03", "00"]
    assert [frame.name[-6:-4] for frame in capture.train] == ["08", "07", "05", "04", "02", "01"]
    assert len(open_capture(capture.path, hold_out=0).train) == 10


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7])
def test_few_frames_are_all_trained_on_unless_asked(ring, write_transforms, count):
    folder = write_transforms(frames=ring.transforms()["frames"][:count])
    for name in ring.names[count:]:
        (folder / "images" / name).unlink()
    capture = open_capture(folder)
    is_whole = count < 4
    assert (len(capture.train), len(capture.held_out)) == ((count, 0) if is_whole else (count - 1, 1))
    assert capture.protocol.endswith("nothing held out") == is_whole
    assert any("fewer than 4 frames: none is held out" in warning for warning in capture.warnings) == is_whole
    assert open_capture(folder, hold_out=0).warnings == ()
    if count >= 2:
        assert len(open_capture(folder, hold_out=2).held_out) == (count + 1) // 2


def test_something_must_be_left_to_train_on(ring, write_transforms):
    frames = ring.transforms()["frames"][:4]
    names = [frame["file_path"] for frame in frames]
    with pytest.raises(PocketGSError, match=r"all of its 4 frames are held out, .* --hold-out 0 trains on all"):
        open_capture(write_transforms(frames=frames, test_filenames=names))


def test_protocol_says_what_was_done(ring, write_transforms):
    folder = write_transforms()
    assert open_capture(folder).protocol == "16x12, held out every 8th by name"
    write_transforms(k1=0.2)
    assert open_capture(folder, lens="ignore").protocol.startswith("as published (distorted), 16x12")
    assert open_capture(folder).protocol == "undistorted, cropped to 14x10, held out every 8th by name"
    assert "undistorted, cropped, downscaled to 7x5" in open_capture(folder, downscale=2).protocol
    assert open_capture(folder, max_size=14).protocol == open_capture(folder).protocol  # a limit that all keep
    assert "downscaled to 13x9" in open_capture(folder, max_size=13).protocol
    transparent = np.zeros((24, 32, 4), dtype=np.uint8)
    write_transforms(k1=0.0)
    Image.fromarray(transparent).save(folder / "images/view_00.png")
    capture = open_capture(folder, background=(1, 0.5, 0), hold_out=0)
    assert capture.protocol == "sizes up to 32x24, on RGB (1, 0.5, 0), nothing held out"
    np.testing.assert_array_equal(capture.train[0].image[0, 0], [255, 128, 0])


def test_ordinals():
    assert [ordinal(n) for n in (2, 3, 8, 11, 21, 112)] == ["2nd", "3rd", "8th", "11th", "21st", "112th"]


def test_importing_does_not_start_the_compiler():
    program = "import sys, pocketgs.capture; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_frames_have_names_of_their_own(small_capture):
    """Poses, masks and points are kept by name."""
    first = small_capture.train[0]
    with pytest.raises(PocketGSError, match=f"2 frames are named '{first.name}'"):
        replace(small_capture, train=[*small_capture.train, first])
    with pytest.raises(PocketGSError, match="expected a name of its own for each"):
        replace(small_capture, held_out=[first])
