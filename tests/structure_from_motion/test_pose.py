"""Structure from motion: errors, result files, and accuracy of poses."""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest
from PIL import ExifTags, Image

from mistakes import write_mistake
from pocketgs.capture import open_capture
from pocketgs.capture.decoding import image_file
from pocketgs.capture.open import lacks_poses, read_listing
from pocketgs.capture.synthetic import true_capture
from pocketgs.cli import main
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.results.video import write_video
from pocketgs.structure_from_motion import attempts
from pocketgs.structure_from_motion.colmap.world import similarity
from pocketgs.structure_from_motion.images import source_files
from pocketgs.structure_from_motion.options import PoseOptions
from pocketgs.structure_from_motion.photographs import Photograph
from pocketgs.structure_from_motion.pose import STAGES, pose, pose_once
from pocketgs.structure_from_motion.process import run_colmap

NAMES = ["0.jpg", "1.jpg", "2.jpg", "3.jpg"]
OUTCOME = {
    "placed": NAMES,
    "points": 7,
    "reprojection_error": 0.5,
    "matched_pairs": 6,
    "parallax_pairs": 0,
    "without_parallax": [],
    "stands_still": False,
    "other_models": [],
    "metric": False,
}


@pytest.fixture
def photographs(tmp_path: Path) -> Path:
    """Four pictures of nothing in particular."""
    folder = tmp_path / "photographs"
    folder.mkdir()
    generator = np.random.default_rng(0)
    for number in range(4):
        picture = generator.integers(0, 256, (48, 64, 3), dtype=np.uint8)
        Image.fromarray(picture).save(folder / f"{number}.jpg")
    (folder / "notes.txt").write_text("not a photograph")
    return folder


@pytest.fixture
def colmap_outcome(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Outcome of a stand-in for COLMAP, which the test may change; it writes a model of cameras side by side."""
    outcome = dict(OUTCOME)

    def run(module: str, job: dict[str, Any], *others: Any) -> dict[str, Any]:
        model = Path(job["model"])
        (model / "cameras.txt").write_text("1 PINHOLE 64 48 60 60 32 24\n")
        lines = [f"{number + 1} 1 0 0 0 {number} 0 0 1 {name}\n\n" for number, name in enumerate(NAMES)]
        (model / "images.txt").write_text("".join(lines))
        (model / "points3D.txt").write_text("")
        return outcome

    monkeypatch.setattr("pocketgs.structure_from_motion.attempts.run_colmap", run)
    monkeypatch.setattr("pocketgs.structure_from_motion.attempts.match", lambda *_: ["matches.npz"])
    return outcome


@pytest.fixture
def without_pycolmap(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pycolmap", None)


@pytest.mark.usefixtures("without_pycolmap")
def test_without_pycolmap(photographs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("pose", "train"):
        with pytest.raises(SystemExit) as stop:
            main([command, str(photographs), "--output", str(tmp_path / "output")])
        assert stop.value.code == 2
        assert "COLMAP, whose package pycolmap is not installed: pip install 'pycolmap>=4.2'" in capsys.readouterr().err
    assert not (tmp_path / "output").exists()


def test_the_command_line_loads_no_pycolmap() -> None:
    program = "import sys, pocketgs.cli; sys.exit('pycolmap' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program]).returncode == 0


@pytest.mark.parametrize("count", [0, 2])
def test_too_few_photographs(photographs: Path, tmp_path: Path, count: int) -> None:
    for photograph in sorted(photographs.glob("*.jpg"))[count:]:
        photograph.rename(photograph.with_suffix(".text"))
    with pytest.raises(PocketGSError, match=rf"photographs: {count} photographs, expected .* at least 3 .*\.jpg"):
        pose(photographs, tmp_path / "output")


def test_what_is_no_input(photographs: Path, tmp_path: Path) -> None:
    with pytest.raises(PocketGSError, match="none: no such file or folder, expected a video or a folder"):
        pose(tmp_path / "none", tmp_path / "output")
    with pytest.raises(PocketGSError, match=r"notes\.txt: 0 photographs"):
        pose(photographs / "notes.txt", tmp_path / "output")
    (tmp_path / "walk.mp4").write_bytes(b"no video")
    with pytest.raises(PocketGSError, match=r"walk\.mp4: cannot be opened"):
        pose(tmp_path / "walk.mp4", tmp_path / "output")


@pytest.mark.parametrize("length", [0, 20, 1000])
@pytest.mark.parametrize("orientation", [1, 6])
def test_photographs_cut_off(
    photographs: Path, tmp_path: Path, colmap_outcome: dict[str, Any], length: int, orientation: int
) -> None:
    """They are left out with a warning, also those that are turned while they are copied."""
    exif, photograph = Image.Exif(), photographs / "2.jpg"
    exif[ExifTags.Base.Orientation] = orientation
    Image.open(photograph).save(photograph, exif=exif)
    photograph.write_bytes(photograph.read_bytes()[:length])
    colmap_outcome["placed"] = ["0.jpg", "1.jpg", "3.jpg"]
    warnings: list[str] = []
    found = pose(photographs, tmp_path / "output", on_warning=warnings.append)
    assert (found.frames, found.registered) == (3, 3)
    assert warnings == [
        f"{photographs}: 1 photograph cannot be decoded: 2.jpg; left out. "
        "If they are damaged, copy them from the camera again"
    ]
    assert json.loads((tmp_path / "output/posed.json").read_text())["damaged"] == ["2.jpg"]
    (photographs / "3.jpg").write_bytes(b"")
    with pytest.raises(
        PocketGSError, match=r"2 photographs cannot be decoded: 2\.jpg, 3\.jpg; expected at least 3 others"
    ):
        pose(photographs, tmp_path / "new" / "output")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["output", "photographs"]


def test_files_that_the_system_does_not_open_are_no_damaged_photographs(
    photographs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def open_file(path: Path) -> NoReturn:
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

    monkeypatch.setattr(image_file, "open_file", open_file)
    with pytest.raises(PocketGSError, match=r"0\.jpg: cannot be read \(Too many open files\)"):
        pose(photographs, tmp_path / "output")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"most_frames": 2}, "most frames: found 2, expected at least 3"),
        ({"max_size": 0}, "max size: found 0, expected 64 to 16777216 pixels"),
        ({"camera_model": "LENS"}, "camera model: found LENS, expected one of SIMPLE_PINHOLE"),
        ({"seed": -1}, "seed: found -1"),
    ],
)
def test_options(options: dict[str, Any], message: str) -> None:
    with pytest.raises(PocketGSError, match=message):
        PoseOptions(**options)


def test_photographs_that_do_not_match(photographs: Path, tmp_path: Path) -> None:
    message = r"photographs: no poses found for 4 images \(\d+ features per image, 0 matching pairs\): take sharp"
    stages: list[str] = []
    with pytest.raises(PocketGSError, match=message):
        pose(photographs, tmp_path / "output", on_stage=stages.append)
    assert stages == [*STAGES, *STAGES[3:]]  # once more with less asked of a match
    assert sorted(path.name for path in tmp_path.iterdir()) == ["photographs"]


def test_a_failure_inside_colmap_is_one_line(tmp_path: Path) -> None:
    job = {"database": str(tmp_path / "none" / "features.db"), "seed": 0, "cameras": []}
    with pytest.raises(PocketGSError, match=r"^COLMAP failed \(.+\)$"):
        run_colmap("verify_and_map", job, tmp_path / "log.txt", lambda stage: None)


def test_a_failure_on_a_full_disk_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    job = {"database": str(tmp_path / "none" / "features.db"), "seed": 0, "cameras": []}
    full = shutil.disk_usage(tmp_path)._replace(free=1_200_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: full)
    with pytest.raises(
        PocketGSError, match=r"^COLMAP failed \(.+\): the disk that holds .* is full \(1\.2 MB are free\)"
    ):
        run_colmap("verify_and_map", job, tmp_path / "log.txt", lambda stage: None)


@pytest.mark.usefixtures("colmap_outcome")
@pytest.mark.parametrize("foreign", ["scene.ply", "images/0.jpg", "posed.json"])
def test_output_with_something_else_in_it(
    photographs: Path, tmp_path: Path, contents: Callable[[Path], dict[str, bytes]], foreign: str
) -> None:
    output = tmp_path / "output"
    (output / foreign).parent.mkdir(parents=True)
    (output / foreign).write_text("mine")
    before = contents(tmp_path)
    with pytest.raises(PocketGSError, match=rf"output: holds {Path(foreign).parts[0]}, expected an empty folder"):
        pose(photographs, output)
    with pytest.raises(PocketGSError, match="is a file, expected a folder"):
        pose(photographs, output / foreign)
    with pytest.raises(PocketGSError, match="photographs: holds"):
        pose(photographs, photographs)
    assert contents(tmp_path) == before


@pytest.mark.usefixtures("colmap_outcome")
@pytest.mark.parametrize("mine", ["masks/0.jpg.png", "images/notes.txt", "sparse/0/project.ini"])
def test_files_of_the_users_are_not_deleted_with_an_earlier_result(
    photographs: Path, tmp_path: Path, contents: Callable[[Path], dict[str, bytes]], mine: str
) -> None:
    output = tmp_path / "output"
    pose(photographs, output)
    (output / mine).parent.mkdir(exist_ok=True)
    (output / mine).write_text("mine")
    before = contents(output)
    with pytest.raises(PocketGSError, match=rf"output/{mine}: was not written by pocketgs.*; move it away, or choose"):
        pose(photographs, output)
    assert contents(output) == before
    # Earlier versions wrote no list: only what lies beside their folders is known to be the user's.
    record = json.loads((output / "posed.json").read_text())
    del record["written"]
    (output / "posed.json").write_text(json.dumps(record))
    pose(photographs, output)
    assert not (output / mine).exists()


@pytest.mark.usefixtures("colmap_outcome")
def test_files_of_file_browsers_are_nobodys(photographs: Path, tmp_path: Path) -> None:
    output = tmp_path / "output"
    output.mkdir()
    for _ in range(2):
        (output / ".DS_Store").touch()
        pose(photographs, output)
        for name in ("Thumbs.db", "._0.jpg"):
            (output / "images" / name).touch()
    assert sorted(path.name for path in output.iterdir()) == ["images", "posed.json", "sparse"]


@pytest.mark.parametrize("nested", [False, True])
def test_a_result_replaces_an_earlier_one_when_complete(
    photographs: Path,
    tmp_path: Path,
    contents: Callable[[Path], dict[str, bytes]],
    colmap_outcome: dict[str, Any],
    nested: bool,
) -> None:
    source, output = photographs, tmp_path / "output"
    if nested:
        source = tmp_path / "source"
        source.mkdir()
        photographs.rename(source / "images")
    originals = contents(source)
    found = pose(source, output)
    assert (found.frames, found.registered, found.points) == (4, 4, 7)
    assert sorted(path.name for path in (output / "images").iterdir()) == ["0.jpg", "1.jpg", "2.jpg", "3.jpg"]
    first = contents(output)
    colmap_outcome["placed"] = []
    with pytest.raises(PocketGSError, match="no poses found"):
        pose(source, output)
    assert contents(output) == first
    colmap_outcome |= {"placed": NAMES[:3], "other_models": [3]}
    warnings: list[str] = []
    pose(source, output, on_warning=warnings.append)
    (warning,) = warnings
    assert warning.startswith("poses of 3 of 4 images were found; left out: 3.jpg. Parts of 3 images fit together but")
    assert json.loads((output / "posed.json").read_text())["unplaced"] == ["3.jpg"]
    colmap_outcome["without_parallax"] = ["2.jpg", "3.jpg"]
    pose(source, output, on_warning=warnings.append)
    assert (
        "left out: 3.jpg. Parts of 3 images fit together but not with the rest. There the camera only" in warnings[-1]
    )
    assert contents(source) == originals
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([source.name, "output"])


@pytest.mark.usefixtures("colmap_outcome")
def test_pictures_that_are_not_read_are_counted(photographs: Path, tmp_path: Path) -> None:
    for name in ("4.dng", "5.DNG", "._6.dng"):
        (photographs / name).touch()
    warnings: list[str] = []
    pose(photographs, tmp_path / "output", on_warning=warnings.append)
    assert warnings == [f"{photographs}: 2 other pictures are not read (.dng)"]


@pytest.mark.usefixtures("colmap_outcome")
def test_a_posed_capture_is_used_again_until_its_source_changes(
    photographs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "result" / "posed"
    assert pose_once(photographs, folder) == folder
    monkeypatch.setitem(sys.modules, "pycolmap", None)
    assert pose_once(photographs, folder) == folder
    with pytest.raises(PocketGSError, match="whose package pycolmap"):
        pose_once(photographs, folder, PoseOptions(max_size=800))
    os.utime(photographs / "1.jpg", (0, 0))
    with pytest.raises(PocketGSError, match="whose package pycolmap"):
        pose_once(photographs, folder)


@pytest.mark.usefixtures("colmap_outcome")
@pytest.mark.parametrize("lost", ["images", "sparse", "sparse/0/images.txt"])
def test_a_posed_capture_without_its_files_is_made_anew(photographs: Path, tmp_path: Path, lost: str) -> None:
    folder = tmp_path / "result" / "posed"
    pose_once(photographs, folder)
    if (folder / lost).is_dir():
        shutil.rmtree(folder / lost)
    else:
        (folder / lost).unlink()
    pose_once(photographs, folder)
    assert len(open_capture(folder).frames) == 4


@pytest.mark.usefixtures("colmap_outcome")
def test_a_posed_capture_beside_the_photographs_is_none_of_them(photographs: Path, tmp_path: Path) -> None:
    """As on a camera's card, where the photographs lie as deep as the capture's copies of them."""
    card = tmp_path / "card"
    (card / "DCIM").mkdir(parents=True)
    photographs.rename(card / "DCIM" / "100APPLE")
    for _ in range(2):
        assert pose(card, card / "posed").frames == 4
    assert source_files(card)[0].parent.name == "100APPLE"
    (card / "DCIM").rename(tmp_path / "elsewhere")
    assert source_files(card)[0].parent.parent.name == "posed"


@pytest.mark.usefixtures("colmap_outcome")
def test_masks_of_photographs(photographs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Masks of a given folder belong to photographs by name; poses are computed again when masks change."""
    mask = Image.fromarray(np.pad(np.ones((24, 64), np.uint8) * 255, ((0, 24), (0, 0))))
    (tmp_path / "segments").mkdir()
    mask.save(tmp_path / "segments/1.png")
    options, folder = PoseOptions(masks=str(tmp_path / "segments")), tmp_path / "posed"
    pose_once(photographs, folder, options)
    assert [path.name for path in (folder / "masks").iterdir()] == ["1.jpg.png"]
    frames = {Path(frame.name).name: frame for frame in open_capture(folder).frames}
    np.testing.assert_array_equal(frames["1.jpg"].mask, np.asarray(mask) > 0)
    assert frames["2.jpg"].mask is None
    mask.save(tmp_path / "segments/2.png")
    monkeypatch.setitem(sys.modules, "pycolmap", None)
    with pytest.raises(PocketGSError, match="whose package pycolmap"):
        pose_once(photographs, folder, options)
    with pytest.raises(PocketGSError, match="nowhere: no such folder"):
        pose_once(photographs, folder, PoseOptions(masks="nowhere"))


def test_photographs_are_no_capture(photographs: Path, written_capture: Path) -> None:
    assert lacks_poses(photographs)
    assert not lacks_poses(written_capture)
    assert not lacks_poses(photographs / "none")
    with pytest.raises(
        PocketGSError, match=r"photographs: photographs without poses, .* run pocketgs pose to make one"
    ):
        open_capture(photographs)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")
def test_ctrl_c_leaves_everything_as_it_was(photographs: Path, tmp_path: Path) -> None:
    Image.effect_noise((2000, 1500), 90).save(photographs / "large.png")
    command = [sys.executable, "-m", "pocketgs", "pose", str(photographs), "--output", str(tmp_path / "output")]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        until = time.monotonic() + 60
        while not list(tmp_path.glob(".output.*.partial/work/matching_0.db")) and time.monotonic() < until:
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (130, "pocketgs: stopped\n")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["photographs"]


@pytest.mark.slow
def test_poses_of_real_photographs(data_folder: Path, tmp_path: Path) -> None:
    """Against those that LLFF's authors published, on the same photographs."""
    found = pose(data_folder / "fern" / "images_8", tmp_path / "posed")
    assert (found.frames, found.registered) == (20, 20)
    assert found.points > 1500
    assert found.reprojection_error < 1
    truth = cameras_by_name(data_folder / "fern", "images_8")
    position_errors, angles = differences(cameras_by_name(tmp_path / "posed"), truth)
    assert position_errors.mean() < 0.02
    assert angles.max() < 1
    capture = open_capture(tmp_path / "posed")
    assert (len(capture.train), len(capture.held_out), len(capture.points or [])) == (17, 3, found.points)


@pytest.mark.slow
def test_the_same_photographs_give_the_same_poses(
    data_folder: Path, tmp_path: Path, contents: Callable[[Path], dict[str, bytes]]
) -> None:
    (tmp_path / "photographs").mkdir()
    for photograph in sorted((data_folder / "fern" / "images_8").iterdir())[:9]:
        shutil.copy(photograph, tmp_path / "photographs")
    for name in ("first", "second"):
        assert pose(tmp_path / "photographs", tmp_path / name, PoseOptions(max_size=300)).registered == 9
    assert contents(tmp_path / "first") == contents(tmp_path / "second")


@pytest.mark.slow
def test_names_may_hold_any_character(data_folder: Path, tmp_path: Path) -> None:
    """Spaces and number signs mean something in COLMAP's lists."""
    originals = sorted((data_folder / "fern" / "images_8").iterdir())[:6]
    for folder, pattern in (("plain", "{}.png"), ("copied", "# IMG {} (1).png")):
        (tmp_path / folder).mkdir()
        for number, original in enumerate(originals):
            shutil.copy(original, tmp_path / folder / pattern.format(number))
        pose(tmp_path / folder, tmp_path / f"{folder}_posed", PoseOptions(max_size=300))
    plain, copied = (cameras_by_name(tmp_path / f"{folder}_posed") for folder in ("plain", "copied"))
    assert sorted(copied) == [f"# IMG {number} (1).png" for number in range(6)]
    for one, other in zip(sorted(plain), sorted(copied), strict=True):
        np.testing.assert_array_equal(plain[one].world_to_camera, copied[other].world_to_camera)


@pytest.mark.slow
def test_poses_of_a_video(tmp_path: Path) -> None:
    capture = true_capture(width=240, height=180, frames=8, points=10)
    frames = sorted(capture.frames, key=lambda frame: frame.name)
    write_video(tmp_path / "walk.mp4", (frame.image for frame in frames), fps=30)
    found = pose(tmp_path / "walk.mp4", tmp_path / "posed", PoseOptions(camera_model="PINHOLE"))
    assert (found.frames, found.registered) == (8, 8)
    truth = {f"frame_{number:06d}.jpg": frame.camera for number, frame in enumerate(frames)}
    position_errors, angles = differences(cameras_by_name(tmp_path / "posed"), truth)
    assert position_errors.mean() < 0.005
    assert angles.max() < 1


@pytest.mark.slow
@pytest.mark.parametrize("refine_lenses", [True, False])
def test_placing_all_photographs_at_once(
    data_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refine_lenses: bool
) -> None:
    """The fallback if adding photographs one by one fails; the guessed focal length is 1 % off."""

    def run(module: str, job: dict[str, Any], *others: Any) -> dict[str, Any]:
        return run_colmap(module, {**job, "mapper": "global", "refine_lenses": refine_lenses}, *others)

    monkeypatch.setattr("pocketgs.structure_from_motion.attempts.run_colmap", run)
    (tmp_path / "photographs").mkdir()
    for photograph in sorted((data_folder / "fern" / "images_8").iterdir())[:12]:
        shutil.copy(photograph, tmp_path / "photographs")
    found = pose(tmp_path / "photographs", tmp_path / "posed", PoseOptions(max_size=400))
    assert (found.frames, found.registered) == (12, 12)
    truth = cameras_by_name(data_folder / "fern", "images_8")
    position_errors, angles = differences(cameras_by_name(tmp_path / "posed"), truth)
    assert position_errors.mean() < 0.05
    assert angles.max() < 2


@pytest.mark.parametrize(
    ("answers", "asked", "warned"),
    [
        # One photograph after the other fails, and placing all at once does not.
        ([0, 0, 4], [("incremental", True), ("incremental", True), ("global", True)], False),
        # The lens cannot be found either.
        ([0, 0, 0, 4], [("incremental", True), ("incremental", True), ("global", True), ("global", False)], True),
        # Placing all at once is worse.
        ([3, 3, 0, 2], [("incremental", True)] * 2 + [("global", True), ("global", False)], False),
    ],
)
def test_attempts(
    photographs: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    colmap_outcome: dict[str, Any],
    answers: list[int],
    asked: list[tuple[str, bool]],
    warned: bool,
) -> None:
    made = attempts.run_colmap
    jobs = []

    def run(module: str, job: dict[str, Any], *others: Any) -> dict[str, Any]:
        jobs.append((job["mapper"], job["refine_lenses"]))
        return {**made(module, job, *others), "placed": NAMES[: answers[len(jobs) - 1]], "parallax_pairs": 6}

    monkeypatch.setattr("pocketgs.structure_from_motion.attempts.run_colmap", run)
    warnings: list[str] = []
    found = pose(photographs, tmp_path / "output", on_warning=warnings.append)
    assert found.registered == max(answers)
    assert jobs == asked
    assert any("do not determine the lens" in warning for warning in warnings) == warned


@pytest.mark.parametrize(("contradicted", "tries"), [(0, 3), (2, 1)])
def test_more_matches_are_not_sought_for_photographs_that_theirs_contradict(
    photographs: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    colmap_outcome: dict[str, Any],
    contradicted: int,
    tries: int,
) -> None:
    """They have enough, of which some are wrong."""
    colmap_outcome.update(placed=NAMES[:2], contradicted=contradicted, parallax_pairs=6)
    made, jobs = attempts.run_colmap, []

    def run(module: str, job: dict[str, Any], *others: Any) -> dict[str, Any]:
        jobs.append(job["mapper"])
        return made(module, job, *others)

    monkeypatch.setattr("pocketgs.structure_from_motion.attempts.run_colmap", run)
    assert pose(photographs, tmp_path / "output").registered == 2
    assert len(jobs) == tries


def test_unplaced_photographs_are_retried_however_many(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, colmap_outcome: dict[str, Any]
) -> None:
    folder = tmp_path / "many"
    folder.mkdir()
    for number in range(50):
        Image.effect_noise((64, 48), 90).save(folder / f"{number}.jpg")
    tried = []

    def match(photographs: Sequence[Photograph], pairs: Sequence[tuple[str, str]], *_: Any) -> list[str]:
        tried.append(len(pairs))
        return ["matches.npz"]

    monkeypatch.setattr("pocketgs.structure_from_motion.attempts.match", match)
    monkeypatch.setattr(attempts, "MAX_EXTRA_PAIRS", 40)
    pose(folder, tmp_path / "output")
    assert tried[1] == 40


@pytest.mark.usefixtures("colmap_outcome")
def test_the_memory_for_photographs_is_bounded(
    photographs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Image.new("RGB", (1000, 1000)).save(photographs / "3.jpg")
    command = ["pose", str(photographs), "--output", str(tmp_path / "output"), "--max-memory"]
    with pytest.raises(SystemExit):
        main([*command, "1"])
    assert "expected at most 1 MB: --max-memory" in capsys.readouterr().err
    main([*command, "100"])
    assert (tmp_path / "output").is_dir()


@pytest.mark.slow
def test_turning_on_the_spot_has_no_poses(tmp_path: Path) -> None:
    write_mistake("turning", tmp_path / "capture", width=240, height=180, frames=8)
    with pytest.raises(PocketGSError, match="no poses found for 8 images"):
        pose(tmp_path / "capture" / "images", tmp_path / "posed")


def test_a_camera_that_stands_still_has_no_poses(tmp_path: Path) -> None:
    """A textured wall, with noise in each photograph, and something that moves before it."""
    generator = np.random.default_rng(0)
    wall = np.kron(generator.integers(0, 256, (45, 60)), np.ones((8, 8), int))
    folder = tmp_path / "photographs"
    folder.mkdir()
    for number in range(6):
        photograph = wall + generator.integers(-5, 6, wall.shape)
        photograph[100:200, 60 * number : 60 * number + 100] = np.kron(wall[::8, ::8], np.ones((4, 4)))[:100, :100]
        Image.fromarray(np.clip(photograph, 0, 255).astype(np.uint8)).save(folder / f"{number}.png")
    started = []
    with pytest.raises(PocketGSError, match="no poses found for 6 images, from a camera that stands still"):
        pose(folder, tmp_path / "posed", on_stage=started.append)
    assert started == ["frames", "features", "matching", "verification"]


def cameras_by_name(capture: Path, images: str | None = None) -> dict[str, Camera]:
    return {Path(frame.name).name: frame.camera for frame in read_listing(capture, images).frames}


def differences(found: dict[str, Camera], truth: dict[str, Camera]) -> tuple[np.ndarray, np.ndarray]:
    """Differences of position, in radii of the cameras' cloud, and of rotation, in degrees, after alignment."""
    names = sorted(found)
    centres = np.array([found[name].centre for name in names])
    true_centres = np.array([truth[name].centre for name in names])
    aligned = similarity(centres, true_centres)
    radius = np.linalg.norm(true_centres - true_centres.mean(axis=0), axis=1).max()
    distances = np.linalg.norm(aligned.apply(centres) - true_centres, axis=1) / radius
    turns = [
        truth[name].world_to_camera[:3, :3] @ aligned.rotation @ found[name].world_to_camera[:3, :3].T for name in names
    ]
    cosines = (np.trace(turns, axis1=1, axis2=2) - 1) / 2
    return distances, np.degrees(np.arccos(np.clip(cosines, -1, 1)))


def test_more_pairs_that_place_fewer_photographs_change_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, colmap_outcome: dict[str, Any]
) -> None:
    """Such an attempt writes no model, and tells nothing of one."""
    folder, made, jobs = tmp_path / "many", attempts.run_colmap, []
    folder.mkdir()
    for number in range(50):
        Image.effect_noise((64, 48), 90).save(folder / f"{number}.jpg")

    def run(module: str, job: dict[str, Any], *others: Any) -> dict[str, Any]:
        jobs.append(job["better_than"])
        if len(jobs) == 1:
            return {**made(module, job, *others), "placed": [f"{number}.jpg" for number in range(45)]}
        pairs = {"matched_pairs": 9, "parallax_pairs": 6, "without_parallax": []}
        return {"placed": ["0.jpg"], **pairs, "stands_still": False}

    monkeypatch.setattr(attempts, "run_colmap", run)
    found = pose(folder, tmp_path / "output")
    assert jobs == [0, 45]
    assert (found.registered, found.points) == (45, 7)
