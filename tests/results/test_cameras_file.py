"""Cameras on disk: round trips, and errors for invalid files."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from conftest import write_nerfstudio
from pocketgs import Capture, PocketGSError
from pocketgs.capture.capture import Frame
from pocketgs.capture.open import list_capture
from pocketgs.capture.origin import with_origin
from pocketgs.files.manifest import MANIFEST, PRIVATE, Manifest, source_of
from pocketgs.results.cameras_file import SavedCameras, read_cameras, with_poses_of, write_cameras
from pocketgs.results.folder import CAMERAS
from pocketgs.results.run import run
from pocketgs.training.options import TrainingOptions


def moved(frames: list[Frame]) -> list[Frame]:
    """The frames, each somewhere else."""
    rng = np.random.default_rng(5)
    found = []
    for frame in frames:
        pose = frame.camera.world_to_camera.copy()
        pose[:3, 3] += rng.normal(size=3) / 3
        found.append(replace(frame, camera=replace(frame.camera, world_to_camera=pose)))
    return found


@pytest.fixture
def path(small_capture: Capture, tmp_path: Path) -> Path:
    write_cameras(tmp_path / "cameras.json", small_capture.frames, refined=True)
    return tmp_path / "cameras.json"


def test_round_trip(small_capture: Capture, tmp_path: Path) -> None:
    """To the last bit, and nothing but poses changes."""
    truth = replace(small_capture, train=moved(small_capture.train), held_out=moved(small_capture.held_out))
    write_cameras(tmp_path / "cameras.json", truth.frames, refined=True)
    found = with_poses_of(small_capture, tmp_path / "cameras.json")
    assert len(found.frames) == len(truth.frames)
    for frame, expected, given_one in zip(found.frames, truth.frames, small_capture.frames, strict=True):
        assert frame.camera.world_to_camera.tobytes() == expected.camera.world_to_camera.tobytes()
        assert frame.camera.world_to_camera.tobytes() != given_one.camera.world_to_camera.tobytes()
        assert frame.name == expected.name
        assert frame.camera.fx == given_one.camera.fx
        assert frame.image is given_one.image
    assert [path.name for path in tmp_path.iterdir()] == ["cameras.json"]


def test_cameras_come_back_as_written(small_capture: Capture, path: Path) -> None:
    saved = read_cameras(path)
    assert saved.refined
    assert list(saved.cameras) == [frame.name for frame in small_capture.frames]
    for frame in small_capture.frames:
        found = saved.cameras[frame.name]
        for entry in ("width", "height", "fx", "fy", "cx", "cy"):
            assert getattr(found, entry) == getattr(frame.camera, entry)
        np.testing.assert_array_equal(found.world_to_camera, frame.camera.world_to_camera)


def test_poses_that_are_the_captures_own_change_nothing(small_capture: Capture, tmp_path: Path) -> None:
    write_cameras(tmp_path / "cameras.json", small_capture.frames, refined=False)
    assert with_poses_of(small_capture, tmp_path / "cameras.json") is small_capture


def test_a_capture_that_was_posed_anew(small_capture: Capture, tmp_path: Path) -> None:
    """Photographs were added, and a later run found the poses of all again, in another world than the scene's."""
    write_cameras(tmp_path / "cameras.json", moved(small_capture.frames)[1:], refined=False)
    posed = replace(small_capture, path=tmp_path / "posed" / "demo")
    with pytest.raises(PocketGSError, match=r"cameras\.json: the poses of .*demo have changed since .*: train again"):
        with_poses_of(posed, tmp_path / "cameras.json")
    saved = read_cameras(tmp_path / "cameras.json")
    assert [saved.shows(frame) for frame in moved(small_capture.frames)] == [False] + [True] * 7
    # Another capture of the same place may have photographs of the same names.
    assert with_poses_of(small_capture, tmp_path / "cameras.json") is small_capture


def test_the_runs_capture_with_other_poses(small_capture: Capture, tmp_path: Path) -> None:
    """It is known by its place. Another file there may hold other poses in the same world."""
    result, toys = tmp_path / "result", tmp_path / "toys"
    for folder in (result / PRIVATE, toys):
        folder.mkdir(parents=True)
    (result / MANIFEST).write_text(Manifest(source=source_of(toys)).encoded())
    write_cameras(result / "cameras.json", moved(small_capture.frames), refined=False)
    with pytest.raises(PocketGSError, match=r"the poses of .*toys have changed since this scene was trained"):
        with_poses_of(replace(small_capture, path=toys), result / "cameras.json")
    for path in (toys / "other.json", tmp_path):
        other = replace(small_capture, path=path)
        assert with_poses_of(other, result / "cameras.json") is other


def test_a_turn_on_the_spot_is_known_up_to_rounding(small_capture: Capture) -> None:
    """Its cameras' spread is rounding, and so are the differences of poses that were written by another program."""
    frames = []
    for number, frame in enumerate(small_capture.frames):
        pose = frame.camera.world_to_camera.copy()
        pose[:3, 3] = -pose[:3, :3] @ (np.array([3.0, -2.0, 5.0]) + 1e-15 * number)
        frames.append(replace(frame, camera=replace(frame.camera, world_to_camera=pose)))
    saved = SavedCameras({frame.name: frame.camera for frame in frames}, refined=False)
    for frame in frames:
        pose = frame.camera.world_to_camera.copy()
        pose[:3, 3] += 1e-11
        assert saved.shows(replace(frame, camera=replace(frame.camera, world_to_camera=pose)))
        pose[:3, 3] += 0.1
        assert not saved.shows(replace(frame, camera=replace(frame.camera, world_to_camera=pose)))


@pytest.mark.parametrize(
    ("entry", "value"),
    [
        ("size", [0, 3]),
        ("size", [3]),
        ("size", "large"),
        ("size", None),
        ("intrinsics", [1, 1, 0]),
        ("intrinsics", [-1, 1, 0, 0]),
        ("intrinsics", [1, 1, 0, float("nan")]),
        ("intrinsics", {}),
    ],
)
def test_what_is_no_camera(small_capture: Capture, path: Path, entry: str, value: Any) -> None:
    document = json.loads(path.read_text())
    name = small_capture.train[1].name
    document["cameras"][name][entry] = value
    path.write_text(json.dumps(document))
    with pytest.raises(PocketGSError, match=rf"cameras\.json: '{name}' is not a camera"):
        read_cameras(path)
    del document["cameras"][name][entry]
    path.write_text(json.dumps(document))
    with pytest.raises(PocketGSError, match=rf"cameras\.json: '{name}' is not a camera"):
        read_cameras(path)


def test_frames_that_the_file_does_not_name_have_no_place_in_its_world(small_capture: Capture, tmp_path: Path) -> None:
    """The run left them out, or they were taken later."""
    known, warnings = moved(small_capture.train)[:3] + moved(small_capture.held_out), list[str]()
    write_cameras(tmp_path / "cameras.json", known, refined=True)
    found = with_poses_of(small_capture, tmp_path / "cameras.json", warnings.append)
    assert [frame.name for frame in found.frames] == [frame.name for frame in known]
    for frame, expected in zip(found.frames, known, strict=True):
        np.testing.assert_array_equal(frame.camera.world_to_camera, expected.camera.world_to_camera)
    [warning] = warnings
    lost = ", ".join(frame.name for frame in small_capture.train[3:])
    assert f"take no part, as in its run: {lost}; to use any that were added since, train again" in warning
    write_cameras(tmp_path / "cameras.json", known[:3], refined=True)
    assert with_poses_of(small_capture, tmp_path / "cameras.json").held_out == []


@pytest.mark.parametrize("prefix", ["", "images_4/"])
def test_photographs_that_a_run_left_out_stay_out(small_capture: Capture, tmp_path: Path, prefix: str) -> None:
    """Also where poses are as given; those of another image folder are known by their poses."""
    write_cameras(tmp_path / "cameras.json", small_capture.train[1:], refined=False)

    def renamed(frames: list[Frame]) -> list[Frame]:
        return [replace(frame, name=prefix + frame.name) for frame in frames]

    train, held_out = renamed(small_capture.train), renamed(small_capture.held_out)
    own = replace(small_capture, path=tmp_path / "posed" / "demo", train=train, held_out=held_out)
    warnings: list[str] = []
    found = with_poses_of(own, tmp_path / "cameras.json", warnings.append)
    assert (found.train, found.held_out) == (train[1:], held_out)
    assert f"1 photograph takes no part, as in its run: {train[0].name};" in warnings[0]
    for other in (replace(own, path=tmp_path), replace(own, train=train[:1])):
        assert with_poses_of(other, tmp_path / "cameras.json") is other


@pytest.mark.parametrize("far", [False, True])
def test_points_of_another_world_are_left_out(small_capture: Capture, tmp_path: Path, far: bool) -> None:
    """Such as those beside inverted transforms; refinement moves cameras a little."""
    frames = []
    for frame in small_capture.frames:
        pose = frame.camera.camera_to_world.copy() if far else frame.camera.world_to_camera.copy()
        pose[:3, 3] += 0.01
        frames.append(replace(frame, camera=replace(frame.camera, world_to_camera=pose)))
    write_cameras(tmp_path / "cameras.json", frames, refined=True)
    assert small_capture.points is not None
    found = with_poses_of(small_capture, tmp_path / "cameras.json")
    assert found.points is (None if far else small_capture.points)


def test_file_of_another_capture(small_capture: Capture, path: Path) -> None:
    foreign = replace(small_capture, train=[replace(f, name=f"x{f.name}") for f in small_capture.train], held_out=[])
    with pytest.raises(PocketGSError, match=r"cameras\.json: names no frame of demo, expected the capture that"):
        with_poses_of(foreign, path)


@pytest.mark.parametrize(
    "content",
    [
        "",
        "hello",
        "[]",
        "7",
        "null",
        "{}",
        '{"cameras": 3, "refined": true}',
        '{"cameras": null, "refined": true}',
        '{"cameras": {}}',
        '{"poses": {}, "refined": true}',
        "\0",
    ],
)
def test_file_that_is_none(small_capture: Capture, path: Path, content: str) -> None:
    path.write_text(content)
    with pytest.raises(PocketGSError, match=r"cameras\.json: not a readable file of cameras"):
        with_poses_of(small_capture, path)


def test_file_cut_off_or_missing(small_capture: Capture, path: Path) -> None:
    whole = path.read_bytes()
    for length in range(0, len(whole) - 2, 101):
        path.write_bytes(whole[:length])
        with pytest.raises(PocketGSError, match=r"cameras\.json: not a readable file of cameras"):
            with_poses_of(small_capture, path)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(PocketGSError, match=r"cameras\.json: not a readable"):
        with_poses_of(small_capture, path)
    path.unlink()
    with pytest.raises(PocketGSError, match=r"cameras\.json: not a readable"):
        with_poses_of(small_capture, path)


@pytest.mark.parametrize(
    "pose",
    [
        None,
        3,
        "north",
        [],
        {},
        np.eye(3).tolist(),
        np.eye(4)[:3].tolist(),
        [[1, 0], [0, 1, 0]],
        (2 * np.eye(4)).tolist(),
        np.zeros((4, 4)).tolist(),
        np.diag([1.0, 1, -1, 1]).tolist(),
        (np.eye(4) * np.nan).tolist(),
        (np.eye(4) + np.inf).tolist(),
        [["1", "x", "0", "0"]] * 4,
    ],
)
def test_what_is_no_pose(small_capture: Capture, path: Path, pose: Any) -> None:
    document = json.loads(path.read_text())
    name = small_capture.train[2].name
    document["cameras"][name]["world_to_camera"] = pose
    path.write_text(json.dumps(document))
    with pytest.raises(PocketGSError, match=rf"cameras\.json: '{name}' is not a camera"):
        with_poses_of(small_capture, path)


@given(
    st.recursive(st.none() | st.floats() | st.text(), lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner))
)
def test_any_json(small_capture: Capture, tmp_path_factory: pytest.TempPathFactory, content: Any) -> None:
    path = tmp_path_factory.mktemp("any") / "cameras.json"
    for document in (
        content,
        {"cameras": content, "refined": True},
        {"cameras": {small_capture.train[0].name: content}, "refined": True},
    ):
        path.write_text(json.dumps(document))
        with pytest.raises(PocketGSError):
            with_poses_of(small_capture, path)


def test_a_file_that_cannot_be_written_leaves_the_old_one(
    small_capture: Capture, path: Path, contents: Callable[[Path], dict[str, bytes]]
) -> None:
    before = contents(path.parent)
    with pytest.raises((PocketGSError, OSError)):
        write_cameras(path / "below" / "cameras.json", small_capture.frames, refined=True)
    assert contents(path.parent) == before


def test_a_run_writes_where_its_world_lies_in_the_captures(small_capture: Capture, tmp_path: Path) -> None:
    """As for captures in a national grid, whose scenes are moved to an origin of their own."""
    far = replace(with_origin(small_capture, (-50_000.0, 20_000.0, 0.0)), origin=(0.0, 0.0, 0.0))
    write_nerfstudio(far, tmp_path / "room")
    options = TrainingOptions(iterations=2, prior="none", evaluate_every=0, engine="cpu")
    run(lambda: list_capture(tmp_path / "room"), tmp_path / "out", options)
    saved = read_cameras(tmp_path / "out" / CAMERAS)
    assert np.abs(saved.origin).max() > 10_000
    for name, camera in saved.cameras.items():
        stated = next(frame.camera for frame in far.frames if frame.name == Path(name).name)
        np.testing.assert_allclose(camera.centre + saved.origin, stated.centre, atol=1e-6)
