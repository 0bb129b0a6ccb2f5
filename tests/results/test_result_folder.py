"""The result folder is published as a whole, and checkpoints are valid or refused."""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from pocketgs.capture import Capture, list_capture
from pocketgs.capture.capture import Frame
from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import memory_bound
from pocketgs.files.plain_names import plain_names
from pocketgs.geometry.lens import Lens
from pocketgs.results.checkpoint import (
    CHECKPOINT,
    INTRINSICS,
    SEEDS,
    TRAINING_CAMERAS,
    UNFINISHED,
    is_checkpoint,
    read_checkpoint,
    write_checkpoint,
)
from pocketgs.results.folder import claimed_for_run, publishing, write_json, write_side_by_side
from pocketgs.results.identity import digest_of_cameras, digest_of_intrinsics, identity_of
from pocketgs.results.reporter import Reporter
from pocketgs.results.run import run
from pocketgs.scene.gaussians import PARAMETERS, SH_COEFFICIENTS, Gaussians
from pocketgs.splat.engine import OptimiserState
from pocketgs.splat.rows import Statistics
from pocketgs.training.options import SizedOptions, TrainingOptions
from pocketgs.training.planning.plan import Plan
from pocketgs.training.result import Checkpoint

RUN = {"capture": "toys", "seed": 3}


@pytest.fixture
def checkpoint() -> Checkpoint:
    return make_checkpoint(5, 1)


def make_checkpoint(count: int, degree: int) -> Checkpoint:
    rng = np.random.default_rng(count)
    shapes = [(count, 3), (count, 3), (count, 4), (count,), (count, SH_COEFFICIENTS[degree], 3)]
    scene = Gaussians(*(rng.normal(size=shape) for shape in shapes))
    moments = rng.normal(size=(2, count, 10 + 3 * SH_COEFFICIENTS[degree])).astype(np.float32)
    return Checkpoint(7, scene, OptimiserState(moments[0], moments[1], 9))


def test_publishing_replaces_files_and_folders(tmp_path: Path, contents: Callable[[Path], dict[str, bytes]]) -> None:
    for number in (b"1", b"2"):
        with publishing(tmp_path / "deep" / "result") as staging:
            (staging / "a.txt").write_bytes(number)
            (staging / "held_out").mkdir()
            (staging / "held_out" / number.decode()).touch()
    found = contents(tmp_path / "deep" / "result")
    found.pop(".pocketgs/manifest.json")
    assert found == {"a.txt": b"2", "held_out/1": b"", "held_out/2": b""}


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, OSError("disk full"), PocketGSError])
def test_exception_leaves_the_earlier_result(
    tmp_path: Path, contents: Callable[[Path], dict[str, bytes]], error: Any
) -> None:
    with publishing(tmp_path) as staging:
        (staging / "a.txt").write_text("old")
    before = contents(tmp_path)

    def publish() -> None:
        with publishing(tmp_path) as staging:
            (staging / "a.txt").write_text("new")
            raise error

    with pytest.raises(PocketGSError if isinstance(error, OSError) else error):
        publish()
    assert contents(tmp_path) == before
    assert sorted(path.name for path in tmp_path.iterdir()) == [".pocketgs", "a.txt"]


def test_folder_that_cannot_be(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("old")
    for folder in (tmp_path / "file", tmp_path / "file" / "result", tmp_path / ("long" * 100)):
        with pytest.raises(PocketGSError, match="cannot be written to"), claimed_for_run(folder):
            pass
    assert (tmp_path / "file").read_text() == "old"


def test_empty_folders_do_not_stay(tmp_path: Path) -> None:
    with claimed_for_run(tmp_path / "deep" / "result"):
        pass
    with pytest.raises(ValueError, match="stop"), publishing(tmp_path / "deep" / "result"):
        raise ValueError("stop")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "given").mkdir()
    with claimed_for_run(tmp_path / "given" / "result"), claimed_for_run(tmp_path / "given"):
        pass
    assert list(tmp_path.rglob("*")) == [tmp_path / "given"]


def test_what_a_killed_run_left_is_cleared_away(tmp_path: Path, checkpoint: Checkpoint) -> None:
    staging = tmp_path / ".pocketgs" / "staging-0123abcd" / "new"
    staging.mkdir(parents=True)
    (staging / "scene.ply").touch()
    (tmp_path / ".unfinished.0123abcd.partial.npz").touch()
    write_checkpoint(tmp_path / UNFINISHED, checkpoint, RUN)
    with claimed_for_run(tmp_path):
        pass
    assert sorted(path.name for path in tmp_path.iterdir()) == [UNFINISHED]


def test_json_of_odd_numbers(tmp_path: Path) -> None:
    numbers = {"nan": float("nan"), "inf": np.float64("inf"), "half": np.float32(0.5), "pair": (1, None), "yes": True}
    write_json(tmp_path / "a.json", {**numbers, "nested": {3: [float("-inf")]}})
    expected = {"nan": None, "inf": None, "half": 0.5, "pair": [1, None], "yes": True, "nested": {"3": [None]}}
    assert json.loads((tmp_path / "a.json").read_text()) == expected


def test_plain_names_are_plain_and_differ() -> None:
    frames = [
        "images/0001.jpg",
        "images/0001.png",
        "images_0001.jpeg",
        "IMAGES/0001",
        "../../etc/passwd",
        "a b\n*?.png",
    ]
    names = plain_names(frames)
    assert names == ["images_0001", "images_0001_2", "images_0001_3", "IMAGES_0001_4", "etc_passwd", "a_b"]
    assert plain_names(["写真/一.jpg", "写真/二.jpg", "é.png"]) == ["写真_一", "写真_二", "é"]


@given(st.lists(st.text(min_size=1, max_size=400).filter(lambda name: name.strip("/.")), max_size=8))
def test_any_name_makes_a_file(frames: list[str]) -> None:
    names = plain_names(frames)
    assert len({name.casefold() for name in names}) == len(frames)
    for name in names:
        assert Path(f"{name}.png").name == f"{name}.png"
        assert len(f"{name}.png".encode()) <= 255


def test_side_by_side(tmp_path: Path) -> None:
    photo = np.random.default_rng(0).integers(0, 256, (4, 6, 3), dtype=np.uint8)
    write_side_by_side(tmp_path, "a", photo, photo / np.float32(255))
    pair = np.asarray(Image.open(tmp_path / "a.png"))
    np.testing.assert_array_equal(pair, np.concatenate([photo, photo], axis=1))


@pytest.mark.parametrize(("count", "degree"), [(1, 0), (5, 1), (4, 3)])
def test_checkpoint_round_trip(tmp_path: Path, count: int, degree: int) -> None:
    written = make_checkpoint(count, degree)
    write_checkpoint(tmp_path / CHECKPOINT, written, RUN)
    read = read_checkpoint(tmp_path, RUN)
    assert (read.iteration, read.state.steps) == (7, 9)
    for name in PARAMETERS:
        assert getattr(read.gaussians, name).tobytes() == getattr(written.gaussians, name).tobytes()
    assert read.state.first_moments.tobytes() == written.state.first_moments.tobytes()
    assert read.state.second_moments.tobytes() == written.state.second_moments.tobytes()
    assert [path.name for path in tmp_path.iterdir()] == [CHECKPOINT]


def test_sums_are_in_a_checkpoint(tmp_path: Path, checkpoint: Checkpoint) -> None:
    sums = Statistics(*np.random.default_rng(0).random((4, 5), np.float32))
    write_checkpoint(tmp_path / CHECKPOINT, replace(checkpoint, statistics=sums), RUN)
    read = read_checkpoint(tmp_path, RUN).statistics
    assert read is not None
    for field in fields(Statistics):
        np.testing.assert_array_equal(getattr(read, field.name), getattr(sums, field.name))


def test_unfinished_run_goes_first(tmp_path: Path, checkpoint: Checkpoint) -> None:
    write_checkpoint(tmp_path / CHECKPOINT, checkpoint, RUN)
    later = Checkpoint(8, checkpoint.gaussians, checkpoint.state)
    write_checkpoint(tmp_path / UNFINISHED, later, RUN)
    assert read_checkpoint(tmp_path, RUN).iteration == 8


def test_no_checkpoint(tmp_path: Path) -> None:
    with pytest.raises(PocketGSError, match=r"holds no unfinished\.npz or checkpoint\.npz"):
        read_checkpoint(tmp_path, RUN)


@pytest.mark.parametrize("run", [{**RUN, "seed": 4}, {**RUN, "recipe": "reference"}])
def test_checkpoint_of_another_run(tmp_path: Path, checkpoint: Checkpoint, run: dict[str, Any]) -> None:
    write_checkpoint(tmp_path / CHECKPOINT, checkpoint, RUN)
    with pytest.raises(PocketGSError, match="belongs to a run with"):
        read_checkpoint(tmp_path, run)


@pytest.mark.parametrize(
    ("key", "value", "other", "words"),
    [
        (SEEDS, "balls", "discs", "a run with seeds 'discs', but this one has 'balls'"),
        (TRAINING_CAMERAS, "a", "b", "a run on other photographs, or on other poses"),
    ],
)
def test_what_older_checkpoints_do_not_know(
    tmp_path: Path, checkpoint: Checkpoint, key: str, value: str, other: str, words: str
) -> None:
    write_checkpoint(tmp_path / CHECKPOINT, checkpoint, RUN)
    assert read_checkpoint(tmp_path, {**RUN, key: value}).iteration == checkpoint.iteration
    write_checkpoint(tmp_path / CHECKPOINT, checkpoint, {**RUN, key: other})
    with pytest.raises(PocketGSError, match=f"belongs to {words}"):
        read_checkpoint(tmp_path, {**RUN, key: value})


@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_cameras_that_differ_by_rounding_are_the_same(small_capture: Capture, unit: float) -> None:
    def frames(rounding: float, farther: float = 0.0) -> list[Frame]:
        generator, found = np.random.default_rng(0), []
        for frame in small_capture.train:
            pose = frame.camera.world_to_camera.copy()
            pose[:3, 3] = unit * (pose[:3, 3] + farther)
            pose[:3] *= 1 + rounding * generator.uniform(-1, 1, (3, 4))
            found.append(replace(frame, camera=replace(frame.camera, world_to_camera=pose)))
        return found

    digest = digest_of_cameras(frames(0))
    assert digest_of_cameras(frames(1e-15)) == digest
    assert digest_of_cameras(frames(0, 1e-4)) != digest
    assert digest_of_cameras(frames(0)[::-1]) != digest


def test_checkpoint_cut_off(tmp_path: Path, checkpoint: Checkpoint) -> None:
    path = tmp_path / CHECKPOINT
    write_checkpoint(path, checkpoint, RUN)
    whole = path.read_bytes()
    for length in [*range(0, len(whole), 37), len(whole) - 1]:
        path.write_bytes(whole[:length])
        with pytest.raises(PocketGSError, match="not a readable checkpoint"):
            read_checkpoint(tmp_path, RUN)


@given(data=st.data())
def test_damaged_checkpoint(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    """Garbage, and a valid file with some bytes changed: it is refused, or the damage does not matter."""
    folder = tmp_path_factory.mktemp("damaged")
    path = folder / CHECKPOINT
    path.write_bytes(data.draw(st.binary(max_size=100)))
    with pytest.raises(PocketGSError):
        read_checkpoint(folder, RUN)
    write_checkpoint(path, make_checkpoint(2, 0), RUN)
    raw = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(raw)
    try:
        read = read_checkpoint(folder, RUN)
    except PocketGSError:
        return
    assert read.gaussians.means.tobytes() == make_checkpoint(2, 0).gaussians.means.tobytes()


@pytest.mark.parametrize(
    "change",
    [
        {"first_moments": np.zeros((5, 21), np.float32)},
        {"second_moments": np.zeros((4, 22), np.float32)},
        {"first_moments": np.zeros((5, 22), np.float64)},
        {"second_moments": np.zeros(3, np.float32)},
        {"means": np.zeros((4, 3), np.float32)},
        {"sh": np.zeros((5, 2, 3), np.float32)},
        {"means": np.array([None] * 5)},
        {"iteration": -1},
        {"steps": -3},
        {"iteration": np.zeros(2)},
        {"iteration": "soon"},
        {"run": "[1, 2]"},
        {"run": "7"},
        {"run": "{"},
    ],
)
def test_checkpoint_with_wrong_parts(tmp_path: Path, checkpoint: Checkpoint, change: dict[str, Any]) -> None:
    path = tmp_path / CHECKPOINT
    write_checkpoint(path, checkpoint, RUN)
    parts = dict(np.load(path))
    np.savez(path, **{**parts, **change})
    with pytest.raises(PocketGSError, match=r"checkpoint\.npz"):
        read_checkpoint(tmp_path, RUN)
    for name in change:
        np.savez(path, **{key: value for key, value in parts.items() if key != name})
        with pytest.raises(PocketGSError, match="not a readable checkpoint"):
            read_checkpoint(tmp_path, RUN)


def test_checkpoint_that_states_a_huge_array(tmp_path: Path, checkpoint: Checkpoint) -> None:
    path = tmp_path / CHECKPOINT
    write_checkpoint(path, checkpoint, RUN)
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    members["means.npy"] = members["means.npy"].replace(b"(5, 3), }", b"(90000000000, 3), }")
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    with pytest.raises(PocketGSError, match="not a readable checkpoint"):
        read_checkpoint(tmp_path, RUN)


def test_a_checkpoint_that_cannot_be_written_does_not_end_the_run(
    written_capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(path: Path, checkpoint: Checkpoint, run: dict[str, Any]) -> None:
        if path.name == UNFINISHED:
            raise PocketGSError(f"{path}: cannot be written (No space left on device)")
        write_checkpoint(path, checkpoint, run)

    for interval in ("SECONDS_BETWEEN_CHECKPOINTS", "PAUSE"):
        monkeypatch.setattr(f"pocketgs.results.checkpoint.{interval}", 0.0)
    monkeypatch.setattr("pocketgs.results.checkpoint.write_checkpoint", fail)
    warnings: list[str] = []
    reporter = Reporter(on_warning=warnings.append)
    options = TrainingOptions(iterations=3, prior="none")
    result = run(lambda: list_capture(written_capture), tmp_path / "result", options, reporter=reporter)
    assert result.summary["iterations"] == 3
    assert len(warnings) == 3
    assert "No space left" in warnings[0]


def test_a_checkpoint_that_would_unpack_to_more_than_memory_is_refused(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / CHECKPOINT, first_moments=np.zeros(50_000_000, np.float32))
    assert (tmp_path / CHECKPOINT).stat().st_size < 1_000_000
    with memory_bound(100), pytest.raises(PocketGSError, match="unpacking 200,000,"):
        read_checkpoint(tmp_path, {})


PLAN = Plan(1, 96, 72, 1000, 1, 0.0, {}, 0.0, 10)


def test_the_newest_checkpoint_goes_first(tmp_path: Path, checkpoint: Checkpoint) -> None:
    """A process that is killed as it ends leaves the checkpoint of its unfinished run behind."""
    for seconds, name in ((1000, UNFINISHED), (2000, CHECKPOINT)):
        write_checkpoint(tmp_path / name, replace(checkpoint, iteration=seconds), {})
        os.utime(tmp_path / name, (seconds, seconds))
    assert read_checkpoint(tmp_path, {}).iteration == 2000
    os.utime(tmp_path / UNFINISHED, (3000, 3000))
    assert read_checkpoint(tmp_path, {}).iteration == 1000


def test_copies_with_new_times_lose_no_iterations(tmp_path: Path, checkpoint: Checkpoint) -> None:
    """A finished run that went on and was killed is copied: the checkpoint of its first end may be the newer file."""
    for seconds, name, iteration in ((1000, UNFINISHED, 90), (2000, CHECKPOINT, 20)):
        write_checkpoint(tmp_path / name, replace(checkpoint, iteration=iteration), RUN)
        os.utime(tmp_path / name, (seconds, seconds))
    assert read_checkpoint(tmp_path, RUN).iteration == 90


def test_a_checkpoint_is_known_without_memory_for_it(tmp_path: Path) -> None:
    write_checkpoint(tmp_path / UNFINISHED, make_checkpoint(4000, 3), RUN)
    with memory_bound(1):
        assert is_checkpoint(tmp_path / UNFINISHED)


def test_other_lenses_are_another_run(tmp_path: Path, checkpoint: Checkpoint, small_capture: Capture) -> None:
    frames = small_capture.train
    half = [Frame(frame.name, frame.camera.resized(48, 36), frame.image[::2, ::2]) for frame in frames]
    longer = [replace(frame, camera=replace(frame.camera, fx=1.3 * frame.camera.fx)) for frame in frames]
    distorted = [
        replace(frame, camera=replace(frame.camera, lens=Lens("opencv", (0.01, 0.0, 0.0, 0.0)))) for frame in frames
    ]
    same, smaller, *others = map(digest_of_intrinsics, (frames, half, longer, distorted))
    assert same == smaller
    write_checkpoint(tmp_path / CHECKPOINT, checkpoint, {**RUN, INTRINSICS: same})
    for other in others:
        with pytest.raises(PocketGSError, match="belongs to a run on other focal lengths or lenses; expected"):
            read_checkpoint(tmp_path, {**RUN, INTRINSICS: other})


@pytest.mark.parametrize(
    "change",
    [
        {"recipe": "reference"},
        {"seed": 1},
        {"sh_degree": 1},
        {"prior": "sparse"},
        {"bundle": False},
        {"source_views": 2},
        {"max_keyframes": 9},
        {"exposure": "off"},
        {"max_gaussians": 999},
        {"strategy": "adc"},
        {"seeds": "balls"},
        {"colours": "on"},
        {"transients": "keep"},
    ],
    ids=lambda change: next(iter(change)),
)
def test_no_run_goes_on_with_options_that_make_another_scene(small_capture: Capture, change: dict[str, Any]) -> None:
    options = SizedOptions()
    assert identity_of(small_capture, replace(options, **change), PLAN) != identity_of(small_capture, options, PLAN)
