"""The page's prior computes the same numbers beside the passes as Python's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from pocketgs.capture import Capture, Frame
from pocketgs.capture.frame_edits import downscaled
from pocketgs.capture.plain_background import plain_background
from pocketgs.capture.synthetic import true_capture
from pocketgs.geometry.camera import Camera
from pocketgs.prior.cloud import complete
from pocketgs.prior.cloud.complete import MAX_SOURCE, completion
from pocketgs.prior.cloud.cpu.merger import CpuMerger
from pocketgs.prior.cloud.detail import detail
from pocketgs.prior.cloud.merge import Candidates
from pocketgs.prior.depth.depth_range import DepthRange, depths_of, narrowed, wide_range
from pocketgs.prior.depth.sensor_depth import completed
from pocketgs.prior.depth.source_views import choose_source_views
from pocketgs.prior.depth.sweep import DepthMap, SweepSettings, step_of
from pocketgs.prior.depth.webgpu.comparison_inputs import other_records
from pocketgs.prior.depth.webgpu.sweep_inputs import packed, source_records
from pocketgs.prior.keyframes import KeyframeSettings, select_keyframes
from pocketgs.prior.scale import estimate_scale
from pocketgs.prior.seen_points import seen_points
from pocketgs.scene.point_cloud import PointCloud
from pocketgs.training.planning.effort import QUICK_KEYFRAMES
from prior.random_depth_maps import random_views, with_copy
from static_site.given import TYPED, plain, plain_cloud, plain_frames

Call = Callable[..., Any]


@pytest.fixture(scope="module")
def capture() -> Capture:
    return true_capture(width=48, height=36, frames=9, points=600)


@pytest.fixture(scope="module")
def frames(capture: Capture) -> list[Frame]:
    """One with a transparent part, one with a mask, one of another size."""
    first, second, third, *others = capture.train
    alpha = np.full(first.image.shape[:2], 255, np.uint8)
    alpha[:, :15] = 90
    alpha[:9] = 0
    masked = replace(third, mask=np.arange(48)[None].repeat(36, 0) > 20)
    return [replace(first, alpha=alpha), downscaled(second, 1.37, None), masked, *others]


def cloud_of(capture: Capture) -> PointCloud:
    assert capture.points is not None
    return capture.points


@pytest.mark.parametrize("after", [(48, 33), (96, 72), (32, 24), (1, 1), (64, 7)])
def test_resized_arrays(call: Call, after: tuple[int, int]) -> None:
    values = np.random.default_rng(0).normal(size=(48, 64)).astype(np.float32)
    script = """
        const [before, after] = [{width: 64, height: 48}, {width: given.after[0], height: given.after[1]}];
        return [module.areaAveraged(given.values, 1, before, after), module.interpolated(given.values, before, after)]
            .map((values) => [...values]);
    """
    given = {"values": values.reshape(-1).tolist(), "after": after}
    found = call("numbers/resizing.js", script, given)
    for some, how in zip(found, (cv2.INTER_AREA, cv2.INTER_LINEAR), strict=True):
        np.testing.assert_allclose(some, cv2.resize(values, after, interpolation=how).reshape(-1), atol=2e-5)


@pytest.mark.parametrize("with_points", [False, True])
@pytest.mark.parametrize("metric", [False, True])
def test_distance_to_the_scene(
    call: Call, capture: Capture, frames: list[Frame], metric: bool, with_points: bool
) -> None:
    """By axes, and where those say nothing by the capture's own points or the spread of the cameras."""
    script = (
        TYPED
        + """
        const cloud = given.cloud && cloudOf(given.cloud);
        return given.sets.map((frames) => {
            return module.scaleOf({train: framesOf(frames), cloud, isMetric: given.metric}, settings);
        });
    """
    )
    away = np.diag([1.0, -1.0, -1.0, 1.0])
    outwards = [away @ frame.camera.world_to_camera for frame in frames]
    parallel, in_one_place = (np.tile(frames[0].camera.world_to_camera, (3, 1, 1)) for _ in range(2))
    parallel[:, 0, 3] += [0.0, 0.2, 0.5]
    turned = [frame.camera.world_to_camera.copy() for frame in frames]
    for pose in turned:
        pose[:3, 3] = -pose[:3, :3] @ [0.3, -0.7, 1.1]
    sets = [
        frames,
        frames[:1],
        *(
            [posed(frame, pose) for frame, pose in zip(frames, poses, strict=False)]
            for poses in (outwards, parallel, turned)
        ),
        [posed(frame, pose) for frame, pose in zip(frames, in_one_place, strict=False)],
    ]
    capture = replace(capture, points=cloud_of(capture) if with_points else None, metric=metric)
    cloud = plain_cloud(cloud_of(capture)) if with_points else None
    given = {"sets": [plain_frames(some) for some in sets], "cloud": cloud, "metric": metric}
    for scale, some in zip(call("prior/scale.js", script, given), sets, strict=True):
        expected = estimate_scale(replace(capture, train=some))
        assert scale["distance"] == pytest.approx(expected.distance, rel=1e-6)
        assert scale["unit"] == pytest.approx(expected.unit, rel=1e-6)


def posed(frame: Frame, pose: np.ndarray) -> Frame:
    return replace(frame, camera=replace(frame.camera, world_to_camera=pose))


def test_points_that_frames_see(call: Call, capture: Capture, frames: list[Frame]) -> None:
    script = (
        TYPED
        + """
        const {ViewCells} = await import(new URL("prior/coverage.js", location.href));
        const views = new ViewCells(framesOf(given.frames), settings.prior.coverage);
        const seen = module.seenPoints(cloudOf(given.cloud), views, settings.prior);
        return seen.map((points) => [...points]);
    """
    )
    given = {"cloud": plain_cloud(cloud_of(capture)), "frames": plain_frames(frames)}
    expected = seen_points(cloud_of(capture), frames)
    assert 20 < min(map(len, expected)) < 600
    for found, points in zip(call("prior/seen_points.js", script, given), expected, strict=True):
        np.testing.assert_array_equal(np.reshape(found, (-1, 3)), points)


@pytest.mark.parametrize("known", [True, False])
def test_keyframes(call: Call, capture: Capture, frames: list[Frame], known: bool) -> None:
    points = seen_points(cloud_of(capture), frames) if known else [np.zeros((0, 3))] * len(frames)
    blurred = replace(frames[3], image=cv2.GaussianBlur(frames[3].image, (9, 9), 2))
    copy = replace(frames[5], name="copy", image=cv2.GaussianBlur(frames[5].image, (5, 5), 1))
    frames, points = [*frames[:3], blurred, *frames[4:], copy], [*points, points[5]]
    script = (
        TYPED
        + """
        const points = given.points.map((some) => Float64Array.from(some));
        const frames = framesOf(given.frames);
        const limits = given.mosts.map((most) => ({...settings.prior.keyframes, max_keyframes: most}));
        return limits.map((limit) => module.selectKeyframes(frames, points, 2.5, limit));
    """
    )
    mosts = QUICK_KEYFRAMES, 5
    given = {"frames": plain_frames(frames), "points": [p.reshape(-1).tolist() for p in points], "mosts": mosts}
    for most, found in zip(mosts, call("prior/keyframes.js", script, given), strict=True):
        decisions = select_keyframes(frames, points, 2.5, KeyframeSettings(max_keyframes=most))
        assert found == [index for index, decision in enumerate(decisions) if decision.kept]
        assert len(frames) - 1 not in found


@pytest.mark.parametrize("few", [False, True])
def test_source_views(call: Call, capture: Capture, few: bool) -> None:
    """With a copy of one view, which is no source view of that one even where there are few others."""
    points = seen_points(cloud_of(capture), capture.train)[4][:60]
    script = """
        const points = Float64Array.from(given.points);
        return given.cameras.map((_, i) => module.chooseSourceViews(i, given.cameras, points, settings.prior.sweep));
    """
    frames = [*capture.train, replace(capture.train[4], name="copy")]
    frames = frames[3:5] + frames[-1:] if few else frames
    cameras = [plain(frame.camera) for frame in frames]
    found = call("prior/source_views.js", script, {"cameras": cameras, "points": points.reshape(-1).tolist()})
    names = [frame.name for frame in frames]
    for keyframe, chosen in zip(frames, found, strict=True):
        expected = choose_source_views(keyframe, frames, points, SweepSettings())
        assert [names[index] for index in chosen] == [frame.name for frame in expected]


def test_views_to_compare(call: Call) -> None:
    """With copies: by the depths up to which their agreement counts."""
    script = """
        const views = given.map(({camera, depth, step}) => ({camera, map: {depth: Float32Array.from(depth), step}}));
        return views.map((_, view) => [...module.otherRecords(views, view, settings.prior.sweep.least_parallax)]);
    """
    for apart in (0.0, 0.0138, 0.02):
        views = with_copy(random_views(0), apart)
        given = []
        for view, (height, width) in enumerate(views.sizes):
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = views.rotations[view], views.translations[view]
            camera = Camera(int(width), int(height), *map(float, views.intrinsics[view]), pose)
            depth = views.depths[view, :height, :width].reshape(-1).tolist()
            given.append({"camera": plain(camera), "depth": depth, "step": float(views.steps[view])})
        for view, found in enumerate(call("prior/comparison_inputs.js", script, given)):
            expected = other_records(views, view)
            np.testing.assert_allclose(np.reshape(found, expected.shape), expected, rtol=1e-5, atol=1e-6)


def test_depth_ranges(call: Call, capture: Capture) -> None:
    keyframe, *others = capture.train[:4]
    points = seen_points(cloud_of(capture), [keyframe])[0]
    script = """
        const {view, sources, found, distance} = given;
        const ranges = settings.prior.depth_range;
        const depths = module.depthsOf(view, Float64Array.from(given.points));
        const wide = module.wideRange(depths, distance, ranges);
        const search = module.narrowed(wide, Float64Array.from(found), view, sources, ranges);
        return [[...depths], ...[wide, search].map((range) => [...module.inverseDepths(range)]),
                module.stepOf(module.inverseDepths(search))];
    """
    for count, found in ((len(points), [2.0] * 30 + [3.0] * 10), (3, [2.0]), (len(points), [1e4] * 30)):
        seen, away = points[:count], np.array(found)
        given = {
            "view": plain(keyframe.camera),
            "sources": [plain(frame.camera) for frame in others],
            "points": seen.reshape(-1).tolist(),
            "found": found,
            "distance": 2.0,
        }
        depths, wide, search, step = call("prior/depth_range.js", script, given)
        widest: DepthRange = wide_range(keyframe, seen, 2.0)
        expected = narrowed(widest, away, keyframe, others)
        np.testing.assert_allclose(depths, depths_of(keyframe, seen), rtol=1e-12)
        np.testing.assert_array_equal(np.float32(wide), widest.inverse_depths)
        np.testing.assert_allclose(search, expected.inverse_depths, rtol=1e-6)
        assert step == pytest.approx(step_of(expected.inverse_depths), rel=1e-4)


def test_inputs_of_a_sweep(call: Call, frames: list[Frame]) -> None:
    script = (
        TYPED
        + """
        const frames = framesOf(given);
        const numbers = module.sweepNumbers(frames, new Float32Array(9), settings.prior.sweep);
        const [view, ...sources] = frames.map(({camera}) => camera);
        return [[...module.packed(frames, numbers, settings.prior.sweep)], [...module.sourceRecords(view, sources)]];
    """
    )
    pixels, records = call("prior/sweep_inputs.js", script, plain_frames(frames))
    expected = source_records(frames[0].camera, [frame.camera for frame in frames[1:]])
    np.testing.assert_array_equal(pixels, packed(frames).reshape(-1))
    np.testing.assert_allclose(records, expected.reshape(-1), rtol=1e-6, atol=1e-6)


def test_detail(call: Call, frames: list[Frame]) -> None:
    script = (
        TYPED
        + """
        const frames = framesOf(given);
        return frames.map((frame) => [...module.detailOf(frame, settings.prior.fusion.detail_scale)]);
    """
    )
    narrow = Frame("narrow", replace(frames[5].camera, width=3), frames[5].image[:, :3].copy())
    some = [frames[4], narrow]
    for found, frame in zip(call("prior/detail.js", script, plain_frames(some)), some, strict=True):
        np.testing.assert_allclose(np.reshape(found, frame.image.shape[:2]), detail(frame.image), atol=1e-6)


def random_candidates(count: int) -> Candidates:
    random = np.random.default_rng(count)
    directions = random.normal(size=(count, 3))
    return Candidates(
        random.normal(size=(count, 3)) * [2.0, 3.0, 0.01],
        random.uniform(size=(count, 3)).astype(np.float32),
        (directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32),
        random.choice([0.01, 0.02, 0.021, 0.03], count).astype(np.float32),
        random.uniform(0, 0.2, count).astype(np.float32),
        random.choice([0.1, 0.5, 0.75], count).astype(np.float32),
    )


@pytest.mark.parametrize(("pixels", "count"), [(6000, 400), (6000, 3000), (200, 5000), (0, 10)])
def test_merged_points(call: Call, pixels: int, count: int) -> None:
    """The same points, in the same order."""
    candidates = random_candidates(pixels)
    script = """
        const { Candidates } = await import(new URL("prior/candidates.js", location.href));
        const candidates = new Candidates(given.footprints.length);
        for (const [name, values] of Object.entries(given.arrays)) {
            candidates[name].set(values);
        }
        candidates.footprints.set(given.footprints);
        candidates.count = given.footprints.length;
        const cloud = module.merged(candidates, given.count, settings.prior.merging);
        return [cloud.positions, cloud.colours, cloud.directions].map((values) => [...values]);
    """
    names = ("positions", "colours", "directions", "details", "confidences")
    arrays = {name: getattr(candidates, name).reshape(-1).tolist() for name in names}
    given = {"arrays": arrays, "footprints": candidates.footprints.tolist(), "count": count}
    expected = CpuMerger().merged(candidates, count)
    found = [np.reshape(values, (-1, 3)) for values in call("prior/merge.js", script, given)]
    assert len(expected) <= count
    for values, name in zip(found, ("positions", "colours", "directions"), strict=True):
        np.testing.assert_allclose(values, getattr(expected, name), atol=1e-6)


@pytest.mark.parametrize(("given_points", "looked_at"), [(600, MAX_SOURCE), (600, 70), (30, MAX_SOURCE), (0, 70)])
def test_completed_clouds(
    call: Call,
    capture: Capture,
    frames: list[Frame],
    given_points: int,
    looked_at: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A cloud with a hole is filled up from the capture's own points, or some of them, and from the surroundings."""
    monkeypatch.setattr(complete, "MAX_SOURCE", looked_at)
    own = cloud_of(capture)
    part = own.select(np.flatnonzero(own.positions[:, 0] < np.median(own.positions[:, 0]))[:given_points])
    centre = capture.train[0].camera.centre
    away = centre - part.positions
    cloud = replace(part, directions=away / np.linalg.norm(away, axis=1, keepdims=True))
    rest = own.select(np.arange(0, len(own), 3)) if given_points else None
    script = (
        TYPED
        + """
        const own = given.own ? cloudOf(given.own) : null;
        const {ViewCells} = await import(new URL("prior/coverage.js", location.href));
        const coverage = {...settings.prior.coverage, max_source: given.looked_at};
        const views = new ViewCells(framesOf(given.frames), coverage);
        const { added, covered } = module.completion(cloudOf(given.cloud), views, own ? [own] : [], 2, 900, coverage);
        return [[added.positions, added.colours, added.directions].map((values) => [...values]), covered];
    """
    )
    given = {
        "cloud": plain_cloud(cloud),
        "own": plain_cloud(rest) if rest else None,
        "frames": plain_frames(frames),
        "looked_at": looked_at,
    }
    arrays, covered = call("prior/complete.js", script, given)
    expected = completion(cloud, frames, [rest] if rest else [], 2.0, 900)
    assert covered == pytest.approx(expected.covered, abs=1e-3)
    assert len(expected.added) > 200
    positions, colours, directions = (np.reshape(values, (-1, 3)) for values in arrays)
    np.testing.assert_allclose(positions, expected.added.positions, atol=1e-4)
    np.testing.assert_allclose(directions, expected.added.directions, atol=1e-5)
    np.testing.assert_allclose(colours, expected.added.colours, atol=2 / 255)


def test_the_plain_background(call: Call, frames: list[Frame]) -> None:
    """Random photographs have none; before a colour, of any size and with masks, they have."""
    script = TYPED + "return given.map((frames) => module.plainBackground(framesOf(frames), settings.capture));"
    opaque = [replace(frame, alpha=None) for frame in frames]
    before = [replace(frame, image=np.where(_inner(frame.image), frame.image, np.uint8(203))) for frame in opaque]
    thin = [downscaled(frame, 36, None) for frame in before[2:4]]
    cases = [opaque, before, thin, [frames[0], *before[1:]]]
    expected = [plain_background(case) for case in cases]
    assert [found is None for found in expected] == [True, False, False, True]
    found = call("capture/plain_background.js", script, [plain_frames(case) for case in cases])
    assert found == [None if colour is None else pytest.approx(colour) for colour in expected]


def _inner(image: np.ndarray) -> np.ndarray:
    inner = np.zeros((*image.shape[:2], 1), dtype=bool)
    inner[4:-4, 4:-4] = True
    return inner


@pytest.mark.parametrize("sure", [0.5, 0.01])
def test_depth_maps_completed_by_the_sensor(call: Call, frames: list[Frame], sure: float) -> None:
    """With and without enough confident pixels, of frames with alpha and with a mask."""
    script = (
        TYPED
        + """
        const all = framesOf(given.frames).map((frame, i) => {
            const [depth, margin] = ["depth", "margin"].map((name) => Float32Array.from(given.maps[i][name]));
            return module.completed({depth, margin, step: 0.1}, frame, settings.prior.sensor_depth);
        });
        return all.map(({depth, margin, step}) => [[...depth], [...margin], step]);
    """
    )
    random = np.random.default_rng(0)
    maps = []
    for frame in frames[:4]:
        shape = frame.image.shape[:2]
        margin = np.where(random.uniform(size=shape) < sure, random.uniform(0.04, 0.3, shape), 0.03)
        depth = random.uniform(1, 5, shape) * (random.uniform(size=shape) < 0.8)
        maps.append(DepthMap(depth.astype(np.float32), margin.astype(np.float32), 0.1))
    given_maps = [{"depth": m.depth.reshape(-1).tolist(), "margin": m.margin.reshape(-1).tolist()} for m in maps]
    given = {"frames": plain_frames(frames[:4]), "maps": given_maps}
    for (depth, margin, step), frame, found in zip(
        call("prior/sensor_depth.js", script, given), frames, maps, strict=False
    ):
        expected = completed(found, frame)
        assert frame.depth is not None
        np.testing.assert_allclose(np.reshape(depth, expected.depth.shape), expected.depth, rtol=1e-6)
        np.testing.assert_array_equal(np.reshape(margin, expected.margin.shape), expected.margin)
        assert step == expected.step
