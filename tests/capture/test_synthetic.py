"""The demo capture agrees with its own ground truth, in memory and as a folder."""

from __future__ import annotations

import json
import signal
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from pocketgs.capture import open_capture
from pocketgs.capture.capture import Capture, Frame
from pocketgs.capture.synthetic import (
    GroundTruth,
    demo_capture,
    demo_ground_truth,
    folder,
    read_ground_truth,
    recording,
    true_capture,
    write_demo,
)
from pocketgs.capture.synthetic.phone import BLURRED_SAMPLES, expose, plan_shots, quantised
from pocketgs.capture.synthetic.recording import POINT_NOISE
from pocketgs.capture.synthetic.room import room
from pocketgs.capture.synthetic.shapes import BALL, BOX, FRUSTUM, hit
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera

WIDTH, HEIGHT, FRAMES = SIZES = 96, 72, 16


@pytest.fixture(scope="module")
def capture() -> Capture:
    return demo_capture(*SIZES)


@pytest.fixture(scope="module")
def truth() -> GroundTruth:
    return demo_ground_truth(*SIZES)


@pytest.fixture(scope="module")
def clean() -> Capture:
    return true_capture(WIDTH, HEIGHT, frames=10, points=900)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A demo folder, to be read only."""
    path = tmp_path_factory.mktemp("written") / "demo"
    write_demo(path, *SIZES)
    return path


def test_every_call_gives_the_same(capture: Capture) -> None:
    for frame, twin in zip(capture.frames, demo_capture(*SIZES).frames, strict=True):
        np.testing.assert_array_equal(frame.image, twin.image)
        np.testing.assert_array_equal(frame.camera.world_to_camera, twin.camera.world_to_camera)


def test_capture_is_what_a_phone_brings_home(capture: Capture, truth: GroundTruth) -> None:
    assert [frame.name for frame in capture.held_out] == ["images/0000.png", "images/0008.png"]
    assert len(capture.train) == FRAMES - 2
    assert capture.metric
    assert capture.points is None
    assert truth.cameras.keys() == truth.depths.keys() == {frame.name for frame in capture.frames}
    for frame in capture.frames:
        assert frame.image.shape == (HEIGHT, WIDTH, 3)
        assert frame.image.dtype == np.uint8
        assert frame.depth is None
        assert frame.image.std() > 35


@pytest.mark.parametrize("frames", [16, 120])
def test_tracker_drifts_by_some_centimetres(frames: int) -> None:
    shots = plan_shots(WIDTH, HEIGHT, frames)
    error = np.linalg.norm(
        aligned(centres([s.sensed for s in shots]), centres([s.camera for s in shots]))
        - centres([s.camera for s in shots]),
        axis=1,
    )
    assert 0.015 < error.mean() < 0.04
    turns = [shot.sensed.world_to_camera[:3, :3] @ shot.camera.world_to_camera[:3, :3].T for shot in shots]
    degrees = np.degrees(np.arccos([(np.trace(turn) - 1) / 2 for turn in turns]))
    assert 0.3 < degrees.mean() < 2
    assert all(shot.sensed.fx == shot.camera.fx for shot in shots)


def test_neighbouring_frames_stand_close_together() -> None:
    steps = np.diff(centres([shot.camera for shot in plan_shots(WIDTH, HEIGHT, 120)]), axis=0)
    assert np.all((np.linalg.norm(steps, axis=1) > 0.03) & (np.linalg.norm(steps, axis=1) < 0.1))


def test_a_fifth_of_the_frames_is_blurred_and_exposure_swings() -> None:
    shots = plan_shots(WIDTH, HEIGHT, 120)
    assert 0.15 < np.mean([len(shot.poses) == BLURRED_SAMPLES for shot in shots]) < 0.25
    gains = np.array([shot.gain for shot in shots])
    assert 0.84 < gains.min() < 0.93
    assert 1.07 < gains.max() < 1.16


def test_held_out_frames_are_clean(capture: Capture) -> None:
    shots = {recording.frame_name(shot): shot for shot in plan_shots(*SIZES)}
    for frame in capture.held_out:
        still = np.repeat(shots[frame.name].camera.camera_to_world[None, :3], 4, axis=0)
        expected = quantised(np.sqrt(expose(room(), frame.camera, still)[0]))
        difference = frame.image.astype(float) - expected
        assert np.abs(difference.mean(axis=(0, 1))).max() < 0.2
        assert 0.8 < difference.std() < 2.2  # the sensor's noise alone


def test_exposure_and_blur_show_in_training_frames(capture: Capture) -> None:
    shots = {recording.frame_name(shot): shot for shot in plan_shots(*SIZES)}
    for frame in capture.train:
        shot = shots[frame.name]
        still = np.repeat(shot.poses[:1], 4, axis=0)
        unspoilt = np.sqrt(expose(room(), frame.camera, still)[0])
        spoilt = frame.image / 255 / shot.gain
        dark = unspoilt.max(axis=2) < 0.8  # nothing is clipped
        assert abs((spoilt - unspoilt)[dark].mean()) < 0.01
        if len(shot.poses) == BLURRED_SAMPLES:
            assert (spoilt - unspoilt)[dark].std() > 3 / 255


def test_depths_agree_between_views(truth: GroundTruth) -> None:
    names = sorted(truth.cameras)
    for source, target in pairwise(names):
        row, column, expected = seen_in(truth, source, target)
        actual = truth.depths[target][row, column]
        # Points hidden in the target lie behind what it sees; none may hover in front of it.
        assert np.mean(np.abs(actual - expected) < 0.05) > 0.6
        assert np.mean(expected < actual - 0.15) < 0.03


def test_every_pixel_sees_the_room(truth: GroundTruth) -> None:
    for depth in truth.depths.values():
        assert depth.dtype == np.float32
        assert 0.3 < depth.min() < depth.max() < 6.5


def test_matt_colours_agree_between_views(clean: Capture) -> None:
    truth = GroundTruth({f.name: f.camera for f in clean.frames}, {f.name: depth_of(f) for f in clean.frames})
    source, target = clean.train[3], clean.train[4]
    row, column, expected_depth = seen_in(truth, source.name, target.name)
    visible = np.abs(depth_of(target)[row, column] - expected_depth) < 0.02
    inside = pixels_inside(truth, source.name, target.name)
    difference = np.abs(target.image[row, column].astype(float) - source.image.reshape(-1, 3)[inside])[visible]
    assert np.median(difference) < 0.3 * np.abs(target.image - target.image.mean(axis=(0, 1))).mean()


def test_highlight_moves_with_the_view() -> None:
    """The sun's reflection in the glossy ball stands elsewhere on the ball when it is seen from elsewhere."""
    scene, shots = room(), plan_shots(192, 144, 120)
    glossy = np.flatnonzero((scene.gloss > 0) & (scene.shapes == BALL))[0]
    middle, radius = scene.bounds[glossy, :3], scene.half_sizes[glossy, 0]
    places = []
    for shot in (shots[10], shots[25]):
        light, depth = expose(scene, shot.camera, shot.poses[:1])
        points = surface_points(shot.camera, depth)
        on_ball = np.abs(np.linalg.norm(points - middle, axis=1) - radius) < 1e-3
        places.append(points[np.argmax(np.where(on_ball, light.reshape(-1, 3).min(axis=1), -1))])
        assert np.linalg.norm(places[-1] - middle) == pytest.approx(radius, abs=1e-3)
    assert np.linalg.norm(places[0] - places[1]) > 0.01


@pytest.mark.parametrize(
    ("shape", "taper"), [(BOX, 1.0), (BALL, 1.0), (FRUSTUM, 1.0), (FRUSTUM, 0.0), (FRUSTUM, 1.5), (FRUSTUM, 0.4)]
)
def test_shapes_are_hit_where_their_surface_is(shape: int, taper: float) -> None:
    generator = np.random.default_rng(1)
    met = 0
    for _ in range(200):
        origin = generator.normal(size=3)
        origin *= 4 / np.linalg.norm(origin)
        direction = generator.uniform(-1, 1, 3) - origin
        steps = np.linspace(0, 2.5, 5001)
        inside = contains(shape, taper, origin + steps[:, None] * direction)
        distance = hit(shape, taper, tuple(origin.tolist()), tuple(direction.tolist()))
        expected = steps[np.argmax(inside)] if inside.any() else np.inf
        # A ray that only grazes the shape may pass between the steps.
        if inside.any() or distance == np.inf:
            assert distance == pytest.approx(expected, abs=1e-3)
            met += inside.any()
        away = (-direction).tolist()
        assert hit(shape, taper, tuple(origin.tolist()), tuple(away)) == np.inf
    assert met > 50


def contains(shape: int, taper: float, points: np.ndarray) -> np.ndarray:
    x, y, z = points.T
    if shape == BOX:
        return np.abs(points).max(axis=1) <= 1
    if shape == BALL:
        return np.linalg.norm(points, axis=1) <= 1
    return (np.abs(z) <= 1) & (np.hypot(x, y) <= (1 + taper) / 2 + (taper - 1) / 2 * z)


def test_shadows_reach_as_far_as_the_sun_grid_promises() -> None:
    """The grid only leaves out parts that cannot shade: with all of them in every cell the picture is the same."""
    scene = room()
    furniture = np.arange(3, len(scene.shapes))
    cells = len(scene.cast_ends) - 1
    thorough = scene._replace(casts=np.tile(furniture, cells), cast_ends=np.arange(cells + 1) * len(furniture))
    for shot in plan_shots(*SIZES)[::5]:
        quick, _ = expose(scene, shot.camera, shot.poses)
        np.testing.assert_array_equal(quick, expose(thorough, shot.camera, shot.poses)[0])


def test_cloud_lies_on_surfaces_that_training_frames_see(clean: Capture) -> None:
    assert clean.points is not None
    assert len(clean.points) == 900
    surfaces = np.concatenate([surface_points(frame.camera, depth_of(frame)) for frame in clean.train])
    nearest = [np.linalg.norm(surfaces - position, axis=1).min() for position in clean.points.positions[::15]]
    assert max(nearest) < 6 * POINT_NOISE


def test_folder_holds_the_capture(capture: Capture, written: Path) -> None:
    opened = open_capture(written)
    assert [frame.name for frame in opened.held_out] == [frame.name for frame in capture.held_out]
    assert (opened.metric, opened.warnings) == (True, ())
    for frame, twin in zip(opened.frames, capture.frames, strict=True):
        assert frame.name == twin.name
        assert frame.depth is None
        np.testing.assert_array_equal(frame.image, twin.image)
        assert_same_camera(frame.camera, twin.camera)


def test_folder_holds_the_ground_truth(truth: GroundTruth, written: Path) -> None:
    stored = read_ground_truth(written)
    assert stored.cameras.keys() == stored.depths.keys() == truth.cameras.keys()
    for name, camera in truth.cameras.items():
        assert_same_camera(stored.cameras[name], camera)
        np.testing.assert_allclose(stored.depths[name], truth.depths[name], atol=1.1e-4)


def test_folder_is_kept_while_current_and_replaced_otherwise(tmp_path: Path) -> None:
    path = tmp_path / "a" / "demo"
    write_demo(path, 16, 12, 4)
    made = (path / "transforms.json").stat().st_mtime_ns
    write_demo(path, 16, 12, 4)
    assert (path / "transforms.json").stat().st_mtime_ns == made
    write_demo(path, 16, 12, 5)
    assert len(open_capture(path).frames) == 5
    (path / "images" / "0003.png").unlink()
    write_demo(path, 16, 12, 5)
    assert len(open_capture(path).frames) == 5
    stamp = json.loads((path / folder.GENERATED).read_text())
    (path / folder.GENERATED).write_text(json.dumps({**stamp, "generator": "older"}))
    write_demo(path, 16, 12, 5)
    assert json.loads((path / folder.GENERATED).read_text()) == stamp
    assert [item.name for item in path.parent.iterdir()] == ["demo"]


def test_empty_folder_is_filled(tmp_path: Path) -> None:
    write_demo(tmp_path, 16, 12, 4)
    assert len(open_capture(tmp_path).frames) == 4


@pytest.mark.parametrize("content", ["notes.txt", folder.GENERATED])
def test_foreign_folder_is_left_alone(tmp_path: Path, content: str) -> None:
    (tmp_path / content).write_text("mine")
    with pytest.raises(PocketGSError, match=rf"{folder.GENERATED}.*expected"):
        write_demo(tmp_path, 16, 12, 4)
    assert [item.name for item in tmp_path.iterdir()] == [content]
    assert (tmp_path / content).read_text() == "mine"


def test_files_of_the_users_are_not_deleted_with_an_older_demo(tmp_path: Path) -> None:
    write_demo(tmp_path / "demo", 16, 12, 4)
    (tmp_path / "demo" / "images" / "notes.txt").write_text("mine")
    write_demo(tmp_path / "demo", 16, 12, 4)
    with pytest.raises(PocketGSError, match=r"demo/images/notes\.txt: was not written by pocketgs"):
        write_demo(tmp_path / "demo", 16, 12, 5)
    assert (tmp_path / "demo" / "images" / "notes.txt").read_text() == "mine"
    (tmp_path / "demo" / "images" / "notes.txt").rename(tmp_path / "demo" / ".DS_Store")
    write_demo(tmp_path / "demo", 16, 12, 5)
    assert len(open_capture(tmp_path / "demo").frames) == 5


def test_file_in_the_way(tmp_path: Path) -> None:
    (tmp_path / "demo").write_text("mine")
    with pytest.raises(PocketGSError, match="demo: "):
        write_demo(tmp_path / "demo", 16, 12, 4)
    with pytest.raises(PocketGSError, match="demo/below: the demo cannot be written"):
        write_demo(tmp_path / "demo" / "below", 16, 12, 4)


def test_interrupted_write_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "demo"

    def interrupted(shot: object) -> str:
        signal.raise_signal(signal.SIGINT)
        return ""

    with monkeypatch.context() as patch:
        patch.setattr(folder, "_depth_name", interrupted)
        with pytest.raises(KeyboardInterrupt):
            write_demo(path, 16, 12, 4)
        assert list(tmp_path.iterdir()) == []
    write_demo(path, 16, 12, 4)
    monkeypatch.setattr(folder, "_depth_name", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_demo(path, 16, 12, 5)
    assert len(open_capture(path).frames) == 4
    assert [item.name for item in tmp_path.iterdir()] == ["demo"]


def test_ground_truth_of_something_else(tmp_path: Path) -> None:
    with pytest.raises(PocketGSError, match="ground_truth"):
        read_ground_truth(tmp_path)


@pytest.mark.parametrize("sizes", [(0, 12, 4), (16, -1, 4), (16, 12, 1)])
def test_rejects_empty_captures(sizes: tuple[int, int, int], tmp_path: Path) -> None:
    for make in (demo_capture, demo_ground_truth, true_capture):
        with pytest.raises(PocketGSError, match="expected at least"):
            make(*sizes)
    with pytest.raises(PocketGSError, match="expected at least"):
        write_demo(tmp_path / "demo", *sizes)
    with pytest.raises(PocketGSError, match="expected at least"):
        true_capture(16, 12, 4, points=0)


def centres(cameras: list[Camera]) -> np.ndarray:
    return np.array([camera.centre for camera in cameras])


def aligned(points: np.ndarray, to: np.ndarray) -> np.ndarray:
    """The points under the similarity that brings them closest to others (Umeyama, 1991)."""
    offsets, targets = points - points.mean(axis=0), to - to.mean(axis=0)
    left, strengths, right = np.linalg.svd(targets.T @ offsets)
    signs = np.array([1, 1, np.sign(np.linalg.det(left @ right))])
    scale = (strengths * signs).sum() / (offsets**2).sum()
    return scale * offsets @ (left * signs @ right).T + to.mean(axis=0)


def depth_of(frame: Frame) -> np.ndarray:
    assert frame.depth is not None
    return frame.depth


def surface_points(camera: Camera, depth: np.ndarray) -> np.ndarray:
    """(H·W, 3) world position of every pixel centre, through the public camera alone."""
    row, column = np.indices(depth.shape)
    rays = np.stack([column + 0.5, row + 0.5, np.ones(depth.shape)], axis=-1)
    local = rays @ np.linalg.inv(camera.intrinsic_matrix).T * depth[..., None]
    return (local.reshape(-1, 3) - camera.world_to_camera[:3, 3]) @ camera.world_to_camera[:3, :3]


def projected(truth: GroundTruth, source: str, target: str) -> tuple[np.ndarray, np.ndarray]:
    return truth.cameras[target].project(surface_points(truth.cameras[source], truth.depths[source]))


def pixels_inside(truth: GroundTruth, source: str, target: str) -> np.ndarray:
    """(H·W,) bool: pixels of the source that are visible in the target's image."""
    pixels, depth = projected(truth, source, target)
    height, width = truth.depths[target].shape
    return (depth > 0) & np.all((pixels > 1) & (pixels < [width - 1, height - 1]), axis=1)


def seen_in(truth: GroundTruth, source: str, target: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row and column in the target of the source's pixels, and their depth there."""
    pixels, depth = projected(truth, source, target)
    inside = pixels_inside(truth, source, target)
    column, row = pixels[inside].astype(int).T
    return row, column, depth[inside]


def assert_same_camera(camera: Camera, other: Camera) -> None:
    np.testing.assert_allclose(camera.intrinsic_matrix, other.intrinsic_matrix, rtol=1e-12)
    np.testing.assert_allclose(camera.world_to_camera, other.world_to_camera, atol=1e-9)
