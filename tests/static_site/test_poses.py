"""The page's poses: tracks, consensus, bundle adjustment, refinement and exposure, as Python computes them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pocketgs.capture.capture import Frame
from pocketgs.capture.synthetic import true_capture
from pocketgs.geometry.camera import Camera
from pocketgs.prior import exposure
from pocketgs.prior.bundle.adjustment import adjust_bundle, adjust_pose
from pocketgs.prior.bundle.cpu.equations import CpuLinearizer
from pocketgs.prior.exposure import compensated, exposure_gains, needs_compensation
from pocketgs.prior.features.cpu.finder import CpuFinder
from pocketgs.prior.features.features import Features
from pocketgs.prior.features.observations import Observations, enough_for_each_view
from pocketgs.prior.features.pairs import WORDS, by_pose, choose_pairs, in_sequence, likeness
from pocketgs.prior.features.tracks import link, triangulate, triangulation_angles
from pocketgs.prior.features.two_view import VERIFICATION, Matches, agreeing
from pocketgs.prior.poses.consensus import consensus
from pocketgs.prior.poses.photometric import correlations
from pocketgs.prior.poses.refinement import refine
from pocketgs.prior.poses.robust_adjustment import RobustAdjustment
from pocketgs.prior.poses.structure import Structure, StructureSettings, _agreeing
from pocketgs.prior.poses.suspects import contradicted, unmatched_views
from pocketgs.prior.poses.tolerance import FINEST, MIN_ANGLE, measured_tolerance, widest_tolerance
from pocketgs.prior.scale import Scale, estimate_scale
from static_site.given import TYPED, plain, plain_frames

Call = Callable[..., Any]

OBSERVED = """
    const observed = ({frame, point, pixels}) => ({
        frame: Int32Array.from(frame),
        point: Int32Array.from(point),
        pixels: Float64Array.from(pixels),
    });
    const posesOf = (cameras) => cameras.map((camera) => camera.world_to_camera);
"""


class Walk(NamedTuple):
    """Views whose given poses are off, what their features match, and where the cameras really were."""

    frames: list[Frame]
    features: list[Features]
    raw: Matches
    matches: Matches
    scale: Scale
    true: list[Camera]


def astray(camera: Camera, rng: np.random.Generator, scale: Scale) -> Camera:
    """Half a degree and 1 % of the distance to the scene off."""
    pose = camera.world_to_camera.copy()
    pose[:3, :3] = Rotation.from_rotvec(rng.normal(0, np.radians(0.5), 3)).as_matrix() @ pose[:3, :3]
    pose[:3, 3] += rng.normal(0, 0.01 * scale.distance, 3)
    return replace(camera, world_to_camera=pose)


@pytest.fixture(scope="module")
def walk() -> Walk:
    capture = true_capture(width=160, height=120, frames=12, points=1)
    scale, rng, finder = estimate_scale(capture), np.random.default_rng(0), CpuFinder()
    frames = [replace(frame, camera=astray(frame.camera, rng, scale)) for frame in capture.train]
    features = [finder.detect(frame, 400) for frame in frames]
    cameras = [frame.camera for frame in frames]
    pairs = sorted({*by_pose(cameras, scale.distance), *in_sequence([frame.name for frame in frames])})
    raw, matches = {}, {}
    for first, second in pairs:
        raw[first, second] = finder.match(features[first], features[second])
        one, other = features[first].pixels[raw[first, second][:, 0]], features[second].pixels[raw[first, second][:, 1]]
        good = agreeing(cameras[first], cameras[second], one, other, VERIFICATION)
        if good.any():
            matches[first, second] = raw[first, second][good]
    return Walk(frames, features, raw, matches, scale, [frame.camera for frame in capture.train])


def plain_cameras(cameras: Sequence[Camera]) -> list[dict[str, Any]]:
    return [plain(camera) for camera in cameras]


def plain_observations(tracks: Observations) -> dict[str, list[float]]:
    return {name: getattr(tracks, name).reshape(-1).tolist() for name in ("frame", "point", "pixels")}


def poses(cameras: Sequence[Camera]) -> np.ndarray:
    return np.array([camera.world_to_camera.reshape(-1) for camera in cameras])


def test_pairs(call: Call, walk: Walk) -> None:
    script = """
        const { likeness } = await import(new URL("prior/features/appearance.js", location.href));
        const rows = likeness(given.words, settings.prior.pairs.words);
        return [module.choosePairs(given.names, given.cameras, rows, given.distance, settings.prior.pairs), rows];
    """
    names = ["b10.png", "b9.png", "b9x.png", "a2.png", "a010.png", "a2b.png", "b1.png", "c.png", "b2.png", "a1.png"]
    cameras = [frame.camera for frame in walk.frames][: len(names)]
    names, features = names[: len(cameras)], walk.features[: len(cameras)]
    vocabulary = np.concatenate([view.descriptors for view in features])
    vocabulary = vocabulary[np.sort(np.random.default_rng(0).permutation(len(vocabulary))[:WORDS])]
    given = {
        "names": names,
        "cameras": plain_cameras(cameras),
        "distance": walk.scale.distance,
        "words": [(view.descriptors @ vocabulary.T).argmax(axis=1).tolist() for view in features],
    }
    pairs, rows = call("prior/features/pairs.js", script, given)
    np.testing.assert_allclose(rows, likeness(features), atol=1e-9)
    assert [tuple(pair) for pair in pairs] == choose_pairs(names, cameras, features, walk.scale.distance)
    assert len(pairs) > len({*by_pose(cameras, walk.scale.distance), *in_sequence(names)})


def of_one_motion(call: Call, walk: Walk, cameras: Sequence[Camera]) -> tuple[np.ndarray, np.ndarray]:
    """Of all pairs' matches, which agree with one motion by the page and by OpenCV, where the page has these poses.

    OpenCV starts from no pose, and chooses at random.
    """
    script = """
        return given.map(([first, second, here, there]) => {
            const pixels = [here, there].map((one) => Float64Array.from(one));
            return [...module.agreeing(first, second, ...pixels, 1.5, settings.prior.two_view)];
        });
    """
    given, expected = [], []
    for (first, second), found in walk.raw.items():
        one, other = cameras[first], cameras[second]
        here, there = walk.features[first].pixels[found[:, 0]], walk.features[second].pixels[found[:, 1]]
        given.append([plain(one), plain(other), here.reshape(-1).tolist(), there.reshape(-1).tolist()])
        expected.append(agreeing(one, other, here, there, VERIFICATION))
    found = call("prior/features/two_view.js", script, given)
    return np.concatenate(found).astype(bool), np.concatenate(expected)


def test_one_motion_explains_the_same_matches(call: Call, walk: Walk) -> None:
    """Poses are off by a degree between two views."""
    found, expected = of_one_motion(call, walk, [frame.camera for frame in walk.frames])
    assert np.mean(found == expected) > 0.95
    assert np.mean(found[expected]) > 0.97


def test_motions_that_the_poses_do_not_tell(call: Call, walk: Walk) -> None:
    """All cameras are said to be where the first one is, turned by 40 degrees from one to the next."""
    cameras = [turned(walk.frames[0].camera, 40 * index) for index in range(len(walk.frames))]
    found, expected = of_one_motion(call, walk, cameras)
    assert np.mean(found == expected) > 0.9
    assert np.mean(found[expected]) > 0.9


def turned(camera: Camera, degrees: float) -> Camera:
    pose = camera.world_to_camera.copy()
    pose[:3] = Rotation.from_euler("y", degrees, degrees=True).as_matrix() @ pose[:3]
    return replace(camera, world_to_camera=pose)


def test_wrong_poses(call: Call, walk: Walk) -> None:
    """One camera is turned by 30 degrees; another view matches nothing. Poses a little off are not suspected."""
    script = """
        const features = given.features.map((pixels) => {
            return { pixels: Float64Array.from(pixels), count: pixels.length / 2 };
        });
        const matches = given.matches.map(([first, second, pairs]) => {
            return { first, second, pairs: Int32Array.from(pairs) };
        });
        const { suspects } = settings.prior;
        return [
            module.contradicted(given.cameras, features, matches, given.tolerance, suspects),
            module.unmatchedViews(given.cameras, features, matches, given.distance, suspects),
        ];
    """
    lone = 7
    matches = {pair: found for pair, found in walk.matches.items() if lone not in pair}
    given_poses = [frame.camera for frame in walk.frames]
    one_turned = [turned(camera, 30) if view == 2 else camera for view, camera in enumerate(given_poses)]
    for cameras, wrong in ((one_turned, [2]), (given_poses, [])):
        given = {
            "cameras": plain_cameras(cameras),
            "features": [view.pixels.reshape(-1).tolist() for view in walk.features],
            "matches": [[*pair, found.reshape(-1).tolist()] for pair, found in matches.items()],
            "tolerance": 4.0,
            "distance": walk.scale.distance,
        }
        found = call("prior/poses/suspects.js", script, given)
        expected = [
            contradicted(cameras, walk.features, matches, 4.0),
            unmatched_views(cameras, walk.features, matches, walk.scale.distance),
        ]
        assert found == [flags.tolist() for flags in expected]
        assert np.flatnonzero(found[0]).tolist() == wrong
        assert np.flatnonzero(found[1]).tolist() == [lone]


def test_tracks_and_points(call: Call, walk: Walk) -> None:
    script = (
        OBSERVED
        + """
        const features = given.features.map((pixels) => {
            return { pixels: Float64Array.from(pixels), count: pixels.length / 2 };
        });
        const matches = given.matches.map(([first, second, pairs]) => {
            return { first, second, pairs: Int32Array.from(pairs) };
        });
        const { tracks, feature } = module.link(features, matches);
        const points = module.triangulate(given.cameras, tracks, settings.prior.poses);
        const angles = module.triangulationAngles(given.cameras, points, tracks);
        const { enoughForEachView } = await import(new URL("prior/features/observations.js", location.href));
        const wanted = enoughForEachView(tracks, given.cameras.length, 20);
        const { consensus } = await import(new URL("prior/poses/consensus.js", location.href));
        const { agrees, support, error } = consensus(given.cameras, tracks, 3, settings.prior.poses);
        return [tracks.frame, tracks.point, tracks.pixels, feature, points, angles, wanted, agrees, support, error]
            .map((values) => [...values]);
    """
    )
    cameras = [frame.camera for frame in walk.frames]
    given = {
        "features": [view.pixels.reshape(-1).tolist() for view in walk.features],
        "matches": [[*pair, found.reshape(-1).tolist()] for pair, found in walk.matches.items()],
        "cameras": plain_cameras(cameras),
    }
    frame, point, pixels, feature, points, angles, wanted, agrees, support, error = (
        np.array([np.nan if value is None else value for value in values], float)
        for values in call("prior/features/tracks.js", script, given)
    )
    tracks, expected_feature = link(walk.features, walk.matches)
    np.testing.assert_array_equal(frame, tracks.frame)
    np.testing.assert_array_equal(point, tracks.point)
    np.testing.assert_array_equal(pixels, tracks.pixels.reshape(-1))
    np.testing.assert_array_equal(feature, expected_feature)
    expected = triangulate(cameras, tracks)
    np.testing.assert_allclose(points.reshape(-1, 3), expected, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(angles, triangulation_angles(cameras, expected, tracks), atol=1e-6)
    np.testing.assert_array_equal(wanted[tracks.point] > 0, enough_for_each_view(tracks, len(cameras), 20))
    voted = consensus(cameras, tracks, 3.0, MIN_ANGLE)
    np.testing.assert_array_equal(agrees > 0, voted.agrees)
    np.testing.assert_array_equal(support, voted.support)
    np.testing.assert_allclose(np.where(np.isnan(error), np.inf, error), voted.error, rtol=1e-6)


def test_bundle_adjustment(call: Call, walk: Walk) -> None:
    script = (
        OBSERVED
        + """
        const points = Float64Array.from(given.points);
        const { cameras } = given;
        const bundle = { ...settings.prior.poses.bundle, ...given.settings };
        const found = module.adjustBundle(cameras, points, observed(given.tracks), bundle, cameras);
        const one = module.adjustPose(cameras[0], points, Float64Array.from(given.pixels), bundle);
        return [posesOf(found.cameras), [...found.points], [...found.residuals], one.world_to_camera];
    """
    )
    cameras = [frame.camera for frame in walk.frames]
    tracks, _ = link(walk.features, walk.matches)
    points, seen = _agreeing(cameras, tracks, 8.0)
    settings = replace(StructureSettings().bundle_settings(walk.scale), iterations=8)
    pixels = walk.true[0].project(points)[0]
    given = {
        "cameras": plain_cameras(cameras),
        "points": points.reshape(-1).tolist(),
        "tracks": plain_observations(seen),
        "pixels": pixels.reshape(-1).tolist(),
        "settings": {name: getattr(settings, name) for name in ("iterations", "position_sigma", "rotation_sigma")},
    }
    found, moved, residuals, one = call("prior/bundle/adjustment.js", script, given)
    expected = adjust_bundle(cameras, points, seen, settings)
    assert expected.rmse_after < 0.5 * expected.rmse_before
    np.testing.assert_allclose(found, poses(expected.cameras), atol=1e-6)
    np.testing.assert_allclose(np.reshape(moved, (-1, 3)), expected.points, atol=1e-4)
    np.testing.assert_allclose(residuals, expected.residuals, atol=1e-4)
    placed = adjust_pose(cameras[0], points, pixels, settings).camera
    np.testing.assert_allclose(one, placed.world_to_camera.reshape(-1), atol=1e-6)


@pytest.mark.parametrize("stray", [True, False])
def test_refinement(call: Call, walk: Walk, stray: bool) -> None:
    """Poses that are off are refined as in Python; right ones stay as they are, to the bit."""
    script = (
        TYPED
        + OBSERVED
        + """
        const [{ cameras, scale }, frames] = [given, framesOf(given.frames)];
        const { poses } = settings.prior;
        const found = module.structureOf(cameras, frames, observed(given.tracks), scale, given.finest, poses);
        const some = module.structureOfFrames(found, [0, 2, 3, 5, 6]);
        const last = Math.max(...some.observations.frame);
        const kept = cameras.map((camera, i) => camera === found.cameras[i]);
        const isOfThem = some.cameras[4] === found.cameras[6];
        return [posesOf(found.cameras), [...found.points], kept, some.points.length / 3, last, isOfThem];
    """
    )
    cameras = [frame.camera for frame in walk.frames] if stray else walk.true
    tracks, _ = link(walk.features, walk.matches)
    scale = {"distance": walk.scale.distance, "unit": walk.scale.unit}
    given = {
        "cameras": plain_cameras(cameras),
        "frames": plain_frames(walk.frames),
        "tracks": plain_observations(tracks),
        "scale": scale,
        "finest": FINEST,
    }
    found, points, kept, seen, last, is_of_them = call("prior/poses/structure.js", script, given)
    widest, settings = widest_tolerance(cameras), StructureSettings().bundle_settings(walk.scale)
    adjustment = RobustAdjustment(cameras, widest, FINEST, settings, CpuLinearizer())
    expected = refine(adjustment, tracks, [frame.image for frame in walk.frames], walk.scale.distance)
    assert expected.moved.any() == stray
    assert kept == [new is old for new, old in zip(expected.cameras, cameras, strict=True)]
    np.testing.assert_allclose(found, poses(expected.cameras), atol=1e-4)
    agreed, _ = _agreeing(expected.cameras, tracks, measured_tolerance(expected.cameras, tracks, FINEST))
    assert abs(len(points) / 3 - len(agreed)) <= 0.01 * len(agreed)
    assert 50 < seen < len(points) / 3
    assert last == 4
    assert is_of_them


def test_photometric_agreement(call: Call, walk: Walk) -> None:
    script = (
        TYPED
        + OBSERVED
        + """
        const [frames, points] = [framesOf(given.frames), Float64Array.from(given.points, (value) => value ?? NaN)];
        const { photometric } = settings.prior.poses;
        const found = module.correlations(given.cameras, frames, observed(given.tracks), points, photometric);
        return Array.from(found, (value) => (Number.isFinite(value) ? value : null));
    """
    )
    tracks, _ = link(walk.features, walk.matches)
    agreed = consensus(walk.true, tracks, 2.0, MIN_ANGLE)
    points = np.where((agreed.support >= 2)[:, None], agreed.others, np.nan)
    given = {
        "cameras": plain_cameras(walk.true),
        "frames": plain_frames(walk.frames),
        "tracks": plain_observations(tracks),
        "points": [None if np.isnan(value) else value for value in points.reshape(-1).tolist()],
    }
    found = np.array(call("prior/poses/photometric.js", script, given), np.float64)
    expected = correlations(walk.true, [frame.image for frame in walk.frames], tracks, points)
    assert np.isfinite(expected).sum() > 100
    np.testing.assert_allclose(found, expected, atol=2e-3)


def jumping(frames: Sequence[Frame]) -> list[Frame]:
    """Every other photograph brighter and redder."""
    gain = np.array([1.3, 1.2, 1.1])
    return [
        replace(frame, image=np.clip(frame.image * gain, 0, 255).astype(np.uint8)) if i % 2 else frame
        for i, frame in enumerate(frames)
    ]


EXPOSED = (
    TYPED
    + OBSERVED
    + """
        const frames = framesOf(given.frames);
        const structure = {
            cameras: given.frames.map(({ camera }) => camera),
            points: Float64Array.from(given.points),
            observations: observed(given.observations),
        };
        const { exposure } = settings.prior;
    """
)
"""The arguments of `exposureGains`, from what `plain_exposed` gives."""


def plain_exposed(frames: Sequence[Frame], structure: Structure, scale: Scale) -> dict[str, Any]:
    return {
        "frames": plain_frames(frames),
        "points": structure.points.reshape(-1).tolist(),
        "observations": plain_observations(structure.observations),
        "distance": scale.distance,
    }


def jumping_walk(walk: Walk) -> tuple[list[Frame], Structure]:
    """Five photographs of a walk that jump in exposure, and the points that they see."""
    frames = [replace(frame, camera=camera) for frame, camera in zip(jumping(walk.frames), walk.true, strict=True)]
    tracks, _ = link(walk.features, walk.matches)
    points, seen = _agreeing(walk.true, tracks, 2.0)
    structure = Structure(
        names=tuple(frame.name for frame in frames),
        cameras=walk.true,
        points=points,
        observations=seen,
        rmse_before=0.0,
        rmse_after=0.0,
        tolerance=2.0,
        refined=False,
        adjusted=False,
    )
    return frames[:5], structure.restricted_to(frames[:5])


def test_exposure(call: Call, walk: Walk) -> None:
    script = (
        EXPOSED
        + """
        const gains = module.exposureGains(frames, structure, given.distance, exposure);
        const needs = [gains, gains.map(() => [1, 1, 1])].map((one) => {
            return module.needsCompensation(structure.cameras, one, given.distance, exposure);
        });
        const [, evened] = module.compensated(frames, given.gains, exposure);
        const few = module.exposureGains(frames, structure, given.distance, { ...exposure, min_points: 1e6 });
        return [gains, needs, [...evened.rgba], few];
    """
    )
    frames, structure = jumping_walk(walk)
    mask = np.ones((120, 160), bool)
    mask[:, :40] = False
    frames[3] = replace(frames[3], mask=mask)
    near_white = frames[1].image.copy()
    near_white[:16, :160] = np.arange(240, 256, dtype=np.uint8)[:, None, None]
    frames[1] = replace(frames[1], image=near_white)
    expected = exposure_gains(frames, structure, walk.scale)
    given = {**plain_exposed(frames, structure, walk.scale), "gains": expected.tolist()}
    gains, needs, evened, few = call("prior/exposure.js", script, given)
    assert np.ptp(expected) > 0.15
    np.testing.assert_allclose(gains, expected, atol=0.01)
    assert needs == [needs_compensation(frames, expected, walk.scale), False]
    assert needs[0]
    assert few == [[1, 1, 1]] * len(frames)
    colours = np.reshape(evened, (120, 160, 4))[:, :, :3].astype(int)
    assert np.abs(colours - compensated(frames, expected)[1].image).max() <= 1
    frames[2] = replace(frames[2], image=np.zeros_like(frames[2].image))
    expected = exposure_gains(frames, structure, walk.scale)
    assert any(np.array_equal(expected[2], other) for other in np.delete(expected, 2, axis=0))
    gains, *_ = call("prior/exposure.js", script, {**given, "frames": plain_frames(frames)})
    np.testing.assert_allclose(gains, expected, atol=0.01)


def test_exposure_of_a_part_of_the_points(call: Call, walk: Walk, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both draw the same ones."""
    script = (
        EXPOSED
        + """
        const { most, least } = given;
        const few = { ...exposure, most_points: most, min_points: least };
        return [module.exposureGains(frames, structure, given.distance, few), exposure.most_points];
    """
    )
    frames, structure = jumping_walk(walk)
    whole, most, least = exposure_gains(frames, structure, walk.scale), 60, 5
    monkeypatch.setattr(exposure, "MIN_POINTS", least)
    monkeypatch.setattr(exposure, "MOST_POINTS", most)
    expected = exposure_gains(frames, structure, walk.scale)
    given = {**plain_exposed(frames, structure, walk.scale), "most": most, "least": least}
    gains, stated = call("prior/exposure.js", script, given)
    assert np.abs(expected - whole).max() > 0.01
    np.testing.assert_allclose(gains, expected, atol=0.005)
    assert stated == 2000
