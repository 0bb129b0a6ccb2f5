"""Errors are one line on stderr with exit status 2, and keep an earlier result."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from pocketgs.capture.options import CaptureOptions
from pocketgs.cli.capture_options import check_without_capture
from pocketgs.errors import PocketGSError


@pytest.fixture
def refused(
    pocketgs: Callable[..., Any], result: Path, contents: Callable[[Path], dict[str, bytes]]
) -> Callable[..., str]:
    """A function that runs a command that must fail, and returns its message."""

    def check(*arguments: object) -> str:
        before = contents(result)
        outcome = pocketgs(*arguments)
        assert outcome.status == 2
        assert outcome.errors.startswith("pocketgs: ")
        assert outcome.errors.count("\n") == 1
        assert "Traceback" not in outcome.output + outcome.errors
        assert contents(result) == before
        return outcome.errors

    return check


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--engine", "webgpu", "--gpu", "voodoo", "--prior", "none"], "expected one named like 'voodoo'"),
        (["--source-views", "0"], "source views: found 0, expected at least 1"),
        (["--max-keyframes", "1"], "max keyframes: found 1, expected at least 2"),
        (["--iterations", "0"], "iterations: found 0, expected at least 1"),
        (["--iterations", "-5"], "iterations: found -5"),
        (["--time-budget", "0"], "time budget: found 0.0, expected seconds above 0"),
        (["--time-budget", "nan"], "time budget: found nan"),
        (["--max-gaussians", "3"], "max gaussians: found 3, expected at least 4"),
        (["--sh-degree", "4"], "SH degree: found 4, expected 0, 1, 2 or 3"),
        (["--threads", "0"], "threads: found 0, expected at least 1"),
        (["--evaluate-every", "-1"], "evaluate every: found -1, expected at least 0"),
        (["--seed", "-1"], "seed: found -1, expected at least 0"),
        (["--downscale", "-2"], "downscale -2.0, expected a factor of at least 1"),
        (["--downscale", "nan"], "downscale nan"),
        (["--downscale", "1000"], "cannot be downscaled by 1000"),
        (["--max-size", "0"], "max_size 0, expected at least 1"),
        (["--background", "0", "0", "2"], "background: found (0.0, 0.0, 2.0), expected three numbers from 0 to 1"),
        (["--hold-out", "1"], "held out every 1 frames, expected at least 2, or 0 for none"),
        (["--images", "images_99"], "images_99: no such folder, expected one with the images that"),
        # Too small for SSIM: to be found out before training, not after.
        (["--max-size", "10"], "a held-out view of 10x8 pixels, expected at least 11"),
    ],
)
def test_options(refused: Callable[..., str], written_capture: Path, result: Path, options: Any, message: str) -> None:
    assert message in refused("train", written_capture, "--output", result, *options)


@pytest.mark.parametrize(
    "options",
    [
        ["--iterations", "many"],
        ["--engine", "gpu"],
        ["--prior", "best"],
        ["--recipe", "fast"],
        ["--seeds", "cubes"],
        ["--exposure", "maybe"],
        ["--no-such-option"],
    ],
)
def test_command_line_that_cannot_be_parsed(
    pocketgs: Callable[..., Any], written_capture: Path, result: Path, options: list[str]
) -> None:
    outcome = pocketgs("train", written_capture, "--output", result, *options)
    assert outcome.status == 2
    assert outcome.errors
    assert "Traceback" not in outcome.output + outcome.errors


def test_no_capture(refused: Callable[..., str], tmp_path: Path, result: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").write_text("hello")
    assert "none: no such file or folder" in refused("train", tmp_path / "none", "--output", result)
    assert "not a capture of a supported format" in refused("train", tmp_path / "empty", "--output", result)
    assert "not a capture of a supported format" in refused("info", tmp_path / "file")
    assert "File name too long" in refused("info", tmp_path / ("long" * 100))
    assert "File name too long" in refused("eval", tmp_path / ("long" * 100), tmp_path)


def test_message_shows_names_as_they_are(refused: Callable[..., str], tmp_path: Path) -> None:
    """Neither as markup nor as an emoji, nor over several lines."""
    assert "/[red]a:smile:b c: no such file" in refused("info", tmp_path / "[red]a:smile:b\nc")


@pytest.mark.parametrize("keep", [3000, 0])
def test_images_cut_off(refused: Callable[..., str], capture_folder: Path, result: Path, keep: int) -> None:
    for image in (capture_folder / "images").iterdir():
        image.write_bytes(image.read_bytes()[:keep])
    message = refused("train", capture_folder, "--output", result)
    assert re.search(r"000[01]\.png: cannot be decoded", message)


def test_cloud_that_is_none(refused: Callable[..., str], capture_folder: Path, result: Path) -> None:
    (capture_folder / "cloud.ply").write_text("ply\n")
    assert "cloud.ply: not a .ply" in refused("train", capture_folder, "--output", result)


def test_mask_that_leaves_nothing_to_compare(refused: Callable[..., str], capture_folder: Path, result: Path) -> None:
    mask = Image.new("L", (96, 72), 0)
    mask.putpixel((0, 0), 255)
    mask.save(capture_folder / "mask.png")
    document = json.loads((capture_folder / "transforms.json").read_text())
    document["frames"][0]["mask_path"] = "mask.png"
    (capture_folder / "transforms.json").write_text(json.dumps(document))
    message = refused("train", capture_folder, "--output", result)
    assert "images/0000.png: the mask of a held-out view leaves nothing" in message


def test_one_training_view_gives_the_reference_recipe_no_length(
    refused: Callable[..., str], capture_folder: Path, result: Path
) -> None:
    document = json.loads((capture_folder / "transforms.json").read_text())
    document["frames"] = document["frames"][:2]
    (capture_folder / "transforms.json").write_text(json.dumps(document))
    options = ["--output", result, "--iterations", "5", "--recipe", "reference", "--prior", "none", "--hold-out", "2"]
    assert "stand in one place" in refused("train", capture_folder, *options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--images", "hires"], "has no poses, so that --images hires has nothing to choose from"),
        (["--hold-out", "1"], "held out every 1 frames, expected at least 2, or 0 for none"),
        (["--downscale", "0.5"], "downscale 0.5, expected a factor of at least 1"),
    ],
)
def test_reading_options_are_checked_before_poses_are_sought(
    refused: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: Any, message: str
) -> None:
    (tmp_path / "photographs").mkdir()
    for number in range(3):
        Image.new("RGB", (64, 48)).save(tmp_path / "photographs" / f"{number}.jpg")
    monkeypatch.setattr("pocketgs.cli.commands.train.pose_once", lambda *_, **__: pytest.fail("sought poses"))
    assert message in refused("train", tmp_path / "photographs", "--output", tmp_path / "new", *options)


@pytest.mark.parametrize("options", [["--images", "images_8"], ["--downscale", "2"], ["--masks", "none"]])
def test_options_of_a_capture_that_is_not_given(
    refused: Callable[..., str], result: Path, tmp_path: Path, options: list[str]
) -> None:
    output = ["--output", tmp_path / "out.pgs"]
    commands = [["view", result, "--no-open"], ["compress", result, *output], ["distil", result, *output]]
    for command in (*commands, ["info", result], ["info", "--devices"]):
        message = refused(*command, *options)
        assert f"{options[0]} only applies to a capture: give " in message
        assert message.endswith(", or leave the option out\n")


def test_a_background_needs_no_capture_where_renderings_use_it() -> None:
    check_without_capture(CaptureOptions(background=(1.0, 1.0, 1.0)), "the capture", but=("background",))
    with pytest.raises(PocketGSError, match="--background only applies to a capture: give the capture, or"):
        check_without_capture(CaptureOptions(background=(1.0, 1.0, 1.0)), "the capture")


@pytest.mark.parametrize(
    ("output", "options", "message"),
    [
        ("out.sog", ["--detail", "small"], "--detail small: expected an output that ends in .spz or .pgs"),
        ("out.pgs", ["--spz-version", "3"], "--spz-version 3: expected an output that ends in .spz"),
        ("out.ply", ["--spz-version", "3"], "--spz-version 3: expected an output that ends in .spz"),
    ],
)
def test_options_of_another_format(
    refused: Callable[..., str], result: Path, tmp_path: Path, output: str, options: list[str], message: str
) -> None:
    assert message in refused("convert", result, tmp_path / output, *options)
    assert not (tmp_path / output).exists()


def test_output_that_cannot_be(
    refused: Callable[..., str], written_capture: Path, result: Path, tmp_path: Path
) -> None:
    file = result / "scene.ply"
    assert "cannot be written to (Not a directory)" in refused("train", written_capture, "--output", file)
    assert "Not a directory" in refused("train", written_capture, "--output", file / "below")
    for output in (file, file / "below", file / "below.mp4"):
        refused("render", result, written_capture, "--output", output, "--frames", "2")
    for option in (["--json", "."], ["--json", file / "a.json"], ["--json", result], ["--pictures", file]):
        refused("eval", result, written_capture, *option)
    assert "cannot be written to" in refused("eval", result, written_capture, "--pictures", file / "below")
    both = ["--pictures", tmp_path / "both", "--json", tmp_path / "both"]
    assert "expected a folder and a file" in refused("eval", result, written_capture, *both)


def test_no_scene(refused: Callable[..., str], written_capture: Path, tmp_path: Path) -> None:
    for path, message in [(tmp_path / "a.ply", "a.ply: no such file"), (written_capture, "scene.ply: no such file")]:
        assert message in refused("eval", path, written_capture)
        assert message in refused("render", path, written_capture, "--output", tmp_path / "rendered")
    assert "a.ply: no such file" in refused("info", tmp_path / "a.ply")
    assert not (tmp_path / "rendered").exists()


@pytest.mark.parametrize("content", [b"", b"hello", b"ply\nend_header\n", b"ply\nformat ascii 1.0\nelement vertex 9\n"])
def test_broken_scene(refused: Callable[..., str], written_capture: Path, result: Path, content: bytes) -> None:
    (result / "scene.ply").write_bytes(content)
    assert "scene.ply: not a" in refused("info", result)
    assert "scene.ply: not a" in refused("eval", result, written_capture)
    assert "scene.ply: not a" in refused("render", result, written_capture, "--output", result / "rendered")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--frames", "0"], "frames: found 0, expected at least 1"),
        (["--views", "held-out", "--hold-out", "0"], "no view is held out"),
        (["--fps", "0"], "fps: found 0.0"),
        (["--fps", "nan"], "fps: found nan"),
        (["--fps", "inf"], "fps: found inf"),
        (["--engine", "webgpu", "--gpu", "voodoo"], "expected one named like 'voodoo'"),
    ],
)
def test_render(refused: Callable[..., str], written_capture: Path, result: Path, options: Any, message: str) -> None:
    output = result.with_name("video.mp4")
    assert message in refused("render", result, written_capture, "--output", output, *options)
    assert not output.exists()


def test_nothing_held_out(refused: Callable[..., str], written_capture: Path, result: Path) -> None:
    assert "no view is held out" in refused("eval", result, written_capture, "--hold-out", "0")


def test_a_video_beside_a_folder_of_its_name(
    pocketgs: Callable[..., Any], written_capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both would go to output/trip; the second must not replace the first."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(written_capture, "trip")
    Path("trip.mp4").write_bytes(b"not decoded")
    assert pocketgs("train", "trip", "--prior", "none", "--iterations", 1).status == 0
    assert pocketgs("train", "trip/transforms.json", "--prior", "none", "--iterations", 1).status == 0
    outcome = pocketgs("train", "trip.mp4")
    assert outcome.status == 2
    assert "holds the result of another capture of this name" in outcome.errors


def test_resume(refused: Callable[..., str], written_capture: Path, result: Path, tmp_path: Path) -> None:
    command = ["train", written_capture, "--resume", "--prior", "none", "--output"]
    assert "40 iterations are already done" in refused(*command, result, "--iterations", "40")
    assert "holds no unfinished.npz or checkpoint.npz" in refused(*command, tmp_path / "new")
    others = [["--seed", "1"], ["--recipe", "reference"], ["--sh-degree", "1"], ["--hold-out", "4"]]
    others += [["--prior", "sparse"], ["--no-bundle"], ["--source-views", "2"], ["--max-keyframes", "5"]]
    others += [["--colours", "on"], ["--transients", "keep"], ["--background", "1", "1", "1"]]
    for option in [*others, ["--exposure", "off"], ["--max-gaussians", "100"]]:
        assert "belongs to a run with" in refused(*command, result, *option)
    (result / "checkpoint.npz").write_bytes(b"hello")
    assert "checkpoint.npz: has been changed since pocketgs wrote it" in refused(*command, result)


@pytest.mark.parametrize("changed", ["names", "poses"])
def test_resume_on_another_capture_of_the_same_name(
    refused: Callable[..., str],
    result: Path,
    capture_folder: Path,
    changed: str,
) -> None:
    """Its photographs have other names, or its cameras are elsewhere; there are as many."""
    document = json.loads((capture_folder / "transforms.json").read_text())
    for frame in document["frames"]:
        if changed == "names":
            before = capture_folder / frame["file_path"]
            frame["file_path"] = f"images/other_{before.name}"
            before.rename(capture_folder / frame["file_path"])
        else:
            frame["transform_matrix"][0][3] += 0.01
    (capture_folder / "transforms.json").write_text(json.dumps(document))
    command = ["train", capture_folder, "--resume", "--prior", "none", "--iterations", "50", "--output", result]
    assert "belongs to a run on other photographs, or on other poses" in refused(*command)


def test_full_disk(
    pocketgs_process: Callable[..., subprocess.Popen[str]],
    written_capture: Path,
    result: Path,
    contents: Callable[[Path], dict[str, bytes]],
) -> None:
    """A limit on the size of files stops the writing of the result half-way, as a full disk does."""
    pytest.importorskip("resource")
    before = contents(result)
    program = (
        "import resource; from pocketgs.cli import main\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))\n"
        "main()"
    )
    process = pocketgs_process("train", written_capture, "--output", result, "--iterations", 2, program=program)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 2
    assert errors.startswith("pocketgs: ")
    assert errors.count("\n") == 1
    assert "File too large" in errors
    assert contents(result) == before


def test_in_a_process_of_its_own(pocketgs_process: Callable[..., subprocess.Popen[str]], tmp_path: Path) -> None:
    output_folder = tmp_path / "output" / "deep"
    command = ["train", tmp_path / "none", "--output", output_folder]
    process = pocketgs_process(*command, program="import runpy; runpy.run_module('pocketgs', run_name='__main__')")
    output, errors = process.communicate(timeout=60)
    assert (process.returncode, output) == (2, "")
    assert not output_folder.parent.exists()
    assert errors == f"pocketgs: {tmp_path / 'none'}: no such file or folder, expected a capture\n"


def test_ctrl_c_names_what_is_kept(pocketgs: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*_: object) -> None:
        raise KeyboardInterrupt("scene.ply is kept in out/unpublished-1234")

    monkeypatch.setattr("pocketgs.cli.commands.evaluate.run_of", stop)
    outcome = pocketgs("eval", "scene.ply", "capture")
    assert (outcome.status, outcome.errors) == (130, "pocketgs: stopped: scene.ply is kept in out/unpublished-1234\n")
