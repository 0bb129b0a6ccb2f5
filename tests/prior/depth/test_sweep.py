"""Plane-sweep stereo: depths against the truth, and which frames it compares with."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from pocketgs import Camera, PocketGSError
from pocketgs.capture.capture import Capture, Frame
from pocketgs.capture.synthetic import true_capture
from pocketgs.geometry.camera import look_at
from pocketgs.prior.depth.cpu.stereo import CpuStereo
from pocketgs.prior.depth.depth_range import DepthRange
from pocketgs.prior.depth.source_views import choose_source_views
from pocketgs.prior.depth.sweep import MAX_PIXELS, DepthMap, SweepSettings, at_sweep_size

SETTINGS = SweepSettings()
STEREO = CpuStereo()
PLANE = np.array([0.25, -0.4, 1.0]), 3.0
"""Normal n and offset d of the plane n · x = d that the frames of `plane` see."""


@pytest.fixture(scope="module")
def table() -> Capture:
    """Eight views of the demo scene, with exact poses and depths."""
    return true_capture(240, 180, frames=8, points=10)


@pytest.fixture(scope="module")
def plane() -> list[Frame]:
    """Five views of one slanted, textured plane, the first from the middle."""
    texture = cv2.GaussianBlur(np.random.default_rng(3).random((512, 512), np.float32), (0, 0), 1.5)
    texture = np.float32(255) * (texture - texture.min()) / (texture.max() - texture.min())
    eyes = [(0, 0, 0), (0.4, 0, 0), (-0.4, 0.05, 0.1), (0, 0.4, 0), (0.05, -0.4, -0.1)]
    return [plane_frame(f"{index}.png", np.array(eye, float), texture) for index, eye in enumerate(eyes)]


def plane_frame(name: str, eye: np.ndarray, texture: np.ndarray) -> Frame:
    camera = Camera(160, 120, 150.0, 150.0, 80.0, 60.0, look_at(eye, np.array([0, 0, 3.0]), np.array([0, -1.0, 0])))
    rows, columns = np.mgrid[0:120, 0:160]
    local = np.stack([(columns + 0.5 - 80) / 150, (rows + 0.5 - 60) / 150, np.ones(rows.shape)], axis=2)
    rays = local @ camera.world_to_camera[:3, :3]
    normal, offset = PLANE
    depth = (offset - normal @ eye) / (rays @ normal)
    points = eye + depth[:, :, None] * rays
    where = (60 * points[:, :, :2] + 256).astype(np.float32)
    grey = cv2.remap(texture, where[:, :, 0], where[:, :, 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_WRAP)
    image = np.repeat(np.clip(np.round(grey), 0, 255).astype(np.uint8)[:, :, None], 3, axis=2)
    return Frame(name, camera, image, depth=depth.astype(np.float32))


def depth_of(frame: Frame) -> np.ndarray:
    assert frame.depth is not None
    return frame.depth


def swept(frame: Frame, source_views: list[Frame], settings: SweepSettings = SETTINGS) -> DepthMap:
    """Swept over a range as wide as a run's."""
    near, far = np.quantile(depth_of(frame), [0.05, 0.95])
    return STEREO.sweep(frame, source_views, DepthRange(0.7 * near, 1.6 * far, 128), settings)


def seen_by(frame: Frame) -> np.ndarray:
    """(M, 3) some points that a frame sees."""
    rows, columns = (grid.ravel() for grid in np.mgrid[10 : frame.camera.height : 20, 10 : frame.camera.width : 20])
    rays = frame.camera.rays(np.column_stack([columns, rows]) + 0.5)
    return np.asarray(frame.camera.centre + rays * depth_of(frame)[rows, columns, None])


def relative_errors(found: DepthMap, frame: Frame) -> np.ndarray:
    """Of the pixels that have a depth."""
    known = found.depth > 0
    return np.abs(found.depth[known] / depth_of(frame)[known] - 1)


@pytest.mark.parametrize("paths", [4, 8])
def test_slanted_plane(plane: list[Frame], paths: int) -> None:
    found = swept(plane[0], plane[1:], replace(SETTINGS, paths=paths))
    assert found.depth.dtype == found.margin.dtype == np.float32
    assert found.depth.shape == found.margin.shape == (120, 160)
    errors = relative_errors(found, plane[0])
    assert len(errors) > 0.99 * found.depth.size
    assert np.median(errors) < 0.004
    assert np.mean(errors < 0.01) > 0.85


def test_one_source_view_is_enough_where_it_sees(plane: list[Frame]) -> None:
    errors = relative_errors(swept(plane[0], plane[1:2]), plane[0])
    assert np.median(errors) < 0.01


def test_demo_scene(table: Capture) -> None:
    """Real shapes: edges, occlusions, and textureless surfaces."""
    keyframe = table.train[3]
    source_views = choose_source_views(keyframe, table.train, seen_by(keyframe), SETTINGS)
    found = swept(keyframe, source_views)
    errors = relative_errors(found, keyframe)
    assert len(errors) > 0.95 * found.depth.size
    assert np.median(errors) < 0.008
    assert np.mean(errors < 0.01) > 0.6
    clear = (found.margin > 0.2)[found.depth > 0]
    assert np.mean(errors[clear] < 0.01) > np.mean(errors[~clear] < 0.01) + 0.1
    assert 0 <= found.margin.min() <= found.margin.max() <= 1


def test_exposure_of_a_reference_does_not_matter(plane: list[Frame]) -> None:
    darker = [
        replace(frame, image=(frame.image * gain).astype(np.uint8))
        for frame, gain in zip(plane[1:], (0.6, 0.7, 0.8, 0.9), strict=True)
    ]
    assert np.mean(relative_errors(swept(plane[0], darker), plane[0]) < 0.01) > 0.85


def test_masks_and_alpha_leave_no_depth(plane: list[Frame]) -> None:
    left = np.arange(160) < 80
    mask = np.tile(left, (120, 1))
    alpha = np.where(np.arange(120) < 60, 255, 100).astype(np.uint8)[:, None] * np.ones((1, 160), np.uint8)
    masked = swept(replace(plane[0], mask=mask), plane[1:]).depth
    np.testing.assert_array_equal(masked > 0, mask)
    cut_out = swept(replace(plane[0], alpha=alpha), plane[1:]).depth
    np.testing.assert_array_equal(cut_out > 0, alpha > 127)


def test_what_masks_leave_out_has_no_say(plane: list[Frame]) -> None:
    """Somebody walks through the pictures, the keyframe's as well."""
    walking = []
    for index, frame in enumerate(plane):
        mask = np.ones((120, 160), bool)
        mask[20:100, 20 + 25 * index : 50 + 25 * index] = False
        walking.append(replace(frame, mask=mask))
    noise = np.random.default_rng(5).integers(0, 255, (120, 160, 3), dtype=np.uint8)
    spoilt = [replace(frame, image=np.where(frame.mask[..., None], frame.image, noise)) for frame in walking]
    found = swept(spoilt[0], spoilt[1:])
    np.testing.assert_array_equal(found.depth, swept(walking[0], walking[1:]).depth)
    assert np.median(relative_errors(found, plane[0])) < 0.008


def test_references_of_other_sizes(plane: list[Frame]) -> None:
    mixed = [at_half_size(plane[1]), plane[2], at_half_size(plane[3]), plane[4]]
    assert np.median(relative_errors(swept(plane[0], mixed), plane[0])) < 0.008


def at_half_size(frame: Frame) -> Frame:
    image = cv2.resize(frame.image, (80, 60), interpolation=cv2.INTER_AREA)
    return replace(frame, camera=frame.camera.resized(80, 60), image=image, depth=None)


def test_references_that_see_nothing_give_nothing(plane: list[Frame]) -> None:
    behind = np.diag([-1.0, 1, -1, 1]) @ plane[1].camera.world_to_camera
    away = replace(plane[1], camera=replace(plane[1].camera, world_to_camera=behind))
    for range_ in (DepthRange(2.0, 5.0, 64), DepthRange(2.0, np.inf, 64)):
        found = STEREO.sweep(plane[0], [away], range_, SETTINGS)
        assert not found.margin.any()
        assert not found.depth.any()


@pytest.mark.parametrize("factor", [2.0**-20, 2.0**14, 2.0**24])
def test_the_unit_of_length_does_not_matter(plane: list[Frame], factor: float) -> None:
    keyframe, *others = [enlarged(frame, factor) for frame in plane]
    expected = STEREO.sweep(plane[0], plane[1:], DepthRange(2.0, 5.0, 64), SETTINGS)
    found = STEREO.sweep(keyframe, others, DepthRange(2.0 * factor, 5.0 * factor, 64), SETTINGS)
    np.testing.assert_array_equal(found.depth / np.float32(factor), expected.depth)


def enlarged(frame: Frame, factor: float) -> Frame:
    """The frame in units of which `factor` make one of its own."""
    pose = frame.camera.world_to_camera.copy()
    pose[:3, 3] *= factor
    return replace(frame, camera=replace(frame.camera, world_to_camera=pose))


def test_what_is_infinitely_far_is_found_there(plane: list[Frame]) -> None:
    """Cameras side by side see the same picture: nothing in it shifts."""
    alike = [
        replace(frame, image=plane[0].image, camera=replace(plane[0].camera, world_to_camera=moved))
        for frame, moved in zip(
            plane[1:], map(moved_by, ([0.3, 0, 0], [-0.3, 0, 0], [0, 0.3, 0], [0, -0.3, 0])), strict=True
        )
    ]
    found = STEREO.sweep(plane[0], alike, DepthRange(1.5, np.inf, 64), SETTINGS)
    beyond = found.depth > found.resolved
    assert np.mean(beyond) > 0.98
    assert np.median(found.margin[beyond]) > 0.3
    # A range that ends somewhere knows that the truth may lie beyond.
    assert np.mean(STEREO.sweep(plane[0], alike, DepthRange(1.5, 300.0, 64), SETTINGS).depth > 0) < 0.05


def moved_by(step: list[float]) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = step
    return pose


def frame_at(name: str, *eye: float, towards: tuple[float, float, float] = (0, 0, 5)) -> Frame:
    pose = look_at(np.array(eye), np.array(towards), np.array([0, -1.0, 0]))
    return Frame(name, Camera(16, 12, 15.0, 15.0, 8.0, 6.0, pose), np.zeros((12, 16, 3), np.uint8))


AHEAD = np.array([[0, 0, 5.0]])


def test_references_are_those_of_the_best_baselines() -> None:
    """At a depth of 5, 8 degrees are a baseline of 0.70."""
    keyframe = frame_at("key", 0, 0, 0)
    good = [frame_at("right", 0.7, 0, 0), frame_at("up", 0, 0.8, 0)]
    # Too near, too far, without parallax, and with its back to the scene.
    poor = [frame_at("near", 0.05, 0, 0), frame_at("far", 4, 0, 0), frame_at("ahead", 0, 0, 0.7)]
    poor.append(frame_at("back", 0.7, 0, 0, towards=(0, 0, -5)))
    settings = SweepSettings(source_views=2, angle=np.radians(8), least_angle=np.radians(4))
    for order in ([keyframe, *poor, *good], [*good[::-1], *poor, keyframe]):
        chosen = choose_source_views(keyframe, order, AHEAD, settings)
        assert [frame.name for frame in chosen] == ["right", "up"]
    assert choose_source_views(keyframe, [keyframe, *good], AHEAD, replace(settings, source_views=1)) == good[:1]
    # Those that tell nothing are not taken, however many are asked for.
    most = choose_source_views(keyframe, [keyframe, *poor, *good], AHEAD, replace(settings, source_views=9))
    assert [frame.name for frame in most] == ["right", "up", "near", "far"]
    copies = [frame_at("copy", 0, 0, 0), frame_at("hardly moved", 0.01, 0, 0)]
    assert choose_source_views(keyframe, [keyframe, *copies], AHEAD, settings) == []
    assert choose_source_views(keyframe, [keyframe], AHEAD, settings) == []


def test_references_look_from_the_side_rather_than_along_the_axis() -> None:
    """A step ahead of the best baseline turns rays less than a step aside of a baseline that is a fifth too long."""
    keyframe = frame_at("key", 0, 0, 0)
    along, aside = frame_at("along", 0.1, 0, 0.69), frame_at("aside", 0.85, 0, 0)
    settings = SweepSettings(source_views=1, angle=np.radians(8), least_angle=np.radians(4))
    assert choose_source_views(keyframe, [along, aside], AHEAD, settings) == [aside]
    assert choose_source_views(keyframe, [along, aside], AHEAD, replace(settings, least_angle=0.001)) == [along]


def test_references_together_see_all_of_the_view() -> None:
    """One source view shows the left half correctly and one the right; all others repeat the left one."""
    keyframe = frame_at("key", 0, 0, 0)
    left, right = [[-1.2, 0, 5.0]], [[1.2, 0, 5.0]]
    sides = [frame_at(f"left{y}", -0.5, y, 0, towards=(-2.6, 0, 5)) for y in (0.48, 0.5, 0.52, 0.54)]
    sides.append(frame_at("right", 0.3, 0.3, 0, towards=(2.6, 0, 5)))
    for side, seen in ((sides[0], (True, False)), (sides[4], (False, True))):
        for point, expected in zip((left, right), seen, strict=True):
            (pixel,), _ = side.camera.project(np.array(point))
            assert (0 <= pixel[0] < 16) == expected
    points = np.array(left * 3 + right * 2)
    chosen = choose_source_views(keyframe, sides, points, replace(SETTINGS, source_views=3))
    assert "right" in [frame.name for frame in chosen]


def test_the_farther_the_scene_the_wider_the_baseline() -> None:
    frames = [frame_at(str(step), 0.25 * step, 0, 0) for step in range(40)]
    nearest, farther = (
        choose_source_views(frames[0], frames, AHEAD * depth, replace(SETTINGS, source_views=1))[0] for depth in (1, 4)
    )
    assert 1 < int(nearest.name) < int(farther.name)


@pytest.mark.parametrize(("width", "height"), [(480, 360), (1920, 1440), (3000, 100), (50, 9000)])
def test_large_frames_are_swept_at_a_smaller_size(width: int, height: int) -> None:
    camera = Camera(width, height, width, width, width / 2, height / 2, np.eye(4))
    frame = Frame("a", camera, np.zeros((height, width, 3), np.uint8))
    found = at_sweep_size(frame)
    if width * height <= MAX_PIXELS:
        assert found is frame
        return
    shape = found.image.shape
    assert 0.9 * MAX_PIXELS < shape[0] * shape[1] <= MAX_PIXELS
    assert (found.camera.height, found.camera.width) == shape[:2]
    # It sees the same.
    assert found.camera.fx / found.camera.width == pytest.approx(camera.fx / camera.width)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"source_views": 0}, "source views: found 0, expected at least 1"),
        ({"paths": 6}, "paths of semi-global matching: found 6, expected 4 or 8"),
    ],
)
def test_bad_settings(change: dict[str, int], message: str) -> None:
    with pytest.raises(PocketGSError, match=message):
        SweepSettings(**change)  # type: ignore[arg-type]
