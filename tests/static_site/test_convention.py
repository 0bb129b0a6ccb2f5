"""The page's check of poses that are wrong as a whole: read in another convention, or unrelated to the photographs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pocketgs.capture import Capture
from pocketgs.capture.synthetic import true_capture
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.prior.features.cpu.finder import CpuFinder
from pocketgs.prior.features.features import Features
from pocketgs.prior.features.two_view import Matches, match_views
from pocketgs.prior.poses.convention import Agreement, MisreadPosesError, check_adjusted, check_convention
from static_site.given import OPEN_FINDER, TYPED, plain, plain_cloud, plain_frames

Call = Callable[..., Any]
Mistake = Callable[[np.ndarray], np.ndarray]

OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
UPRIGHT = np.array([[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
MISTAKES: list[Mistake] = [
    lambda pose: pose,
    lambda pose: OPENGL @ pose,
    np.linalg.inv,
    lambda pose: np.linalg.inv(OPENGL @ pose),
    lambda pose: UPRIGHT @ pose,
]


TYPED_WALK = """
        const features = given.features.map((pixels) => ({ pixels: Float32Array.from(pixels) }));
        const matches = given.matches.map((one) => ({ ...one, pairs: Int32Array.from(one.pairs) }));
"""
"""Gives the page's types to what `plain_walk` makes."""


class Walk(NamedTuple):
    """A walk with exact poses, and what its features match."""

    capture: Capture
    features: list[Features]
    matches: Matches


@pytest.fixture(scope="module")
def walk() -> Walk:
    capture = true_capture(width=160, height=120, frames=10, points=500)
    finder, cameras = CpuFinder(), [frame.camera for frame in capture.train]
    features = [finder.detect(frame, 400) for frame in capture.train]
    pairs = [(first, first + step) for step in (1, 2) for first in range(len(cameras) - step)]
    return Walk(capture, features, match_views(cameras, features, pairs, finder))


def misread(camera: Camera, mistake: Mistake) -> Camera:
    return replace(camera, world_to_camera=mistake(camera.world_to_camera))


def said_by_python(cameras: list[Camera], walk: Walk) -> tuple[str, list[Camera]]:
    try:
        check_convention(cameras, [view.pixels for view in walk.features], walk.matches)
    except MisreadPosesError as error:
        return str(error.convention), [error.convention.applied(camera) for camera in cameras]
    except PocketGSError as error:
        return str(error), []
    return "", []


def plain_walk(walk: Walk) -> dict[str, Any]:
    """What the page's checks take, but for cameras."""
    matches = [
        {"first": first, "second": second, "pairs": found.reshape(-1).tolist()}
        for (first, second), found in walk.matches.items()
    ]
    return {"features": [view.pixels.reshape(-1).tolist() for view in walk.features], "matches": matches}


def said_by_page(call: Call, walk: Walk, several: list[list[Camera]]) -> list[tuple[str, list[list[float]]]]:
    script = (
        TYPED_WALK
        + """
        return given.several.map((cameras) => {
            try {
                module.checkConvention(cameras, features, matches, settings.prior.poses);
                return ["", []];
            } catch (error) {
                const read = error.convention ? cameras.map((camera) => module.readIn(camera, error.convention)) : [];
                return [error.message, read.map(({ world_to_camera: m }) => m)];
            }
        });
    """
    )
    given = plain_walk(walk) | {"several": [[plain(camera) for camera in cameras] for cameras in several]}
    return [tuple(said) for said in call("prior/poses/convention.js", script, given)]


def test_adjusted_poses_are_judged_as_in_python(call: Call, walk: Walk) -> None:
    cameras = [frame.camera for frame in walk.capture.train]
    wrong = [misread(camera, np.linalg.inv) for camera in cameras]
    script = (
        TYPED_WALK
        + """
        return given.cases.map(([share, cameras]) => {
            try {
                module.checkAdjusted({ share, matches: 700 }, cameras, features, matches, settings.prior.poses);
                return "";
            } catch (error) {
                return error.message;
            }
        });
    """
    )
    cases = [(0.3, cameras), (0.3, wrong), (0.6, wrong)]
    given = plain_walk(walk) | {"cases": [[share, [plain(camera) for camera in some]] for share, some in cases]}
    right, refused, mostly_right = call("prior/poses/convention.js", script, given)
    assert right == mostly_right == ""
    assert "70 % of 700 matches contradict the capture's poses" in refused
    with pytest.raises(PocketGSError, match="70% of 700"):
        check_adjusted(Agreement(0.3, 700), wrong, [view.pixels for view in walk.features], walk.matches)


def test_conventions_are_pythons(call: Call, walk: Walk) -> None:
    cameras = [frame.camera for frame in walk.capture.train]
    several = [[misread(camera, mistake) for camera in cameras] for mistake in MISTAKES]
    for given, (message, read) in zip(several, said_by_page(call, walk, several), strict=True):
        expected, right = said_by_python(given, walk)
        assert message.endswith(expected)
        assert bool(message) == bool(expected)
        found = np.reshape(read, (-1, 4, 4))
        np.testing.assert_allclose(found, np.reshape([one.world_to_camera for one in right], (-1, 4, 4)), atol=1e-12)


def test_poses_of_something_else_are_refused(call: Call, walk: Walk) -> None:
    def other(camera: Camera) -> Camera:
        pose = np.eye(4)
        pose[:3, :3] = Rotation.random(random_state=rng.integers(1000)).as_matrix()
        pose[:3, 3] = rng.normal(size=3)
        return replace(camera, world_to_camera=pose)

    rng = np.random.default_rng(0)
    cameras = [other(frame.camera) for frame in walk.capture.train]
    [(message, _)] = said_by_page(call, walk, [cameras])
    expected, _ = said_by_python(cameras, walk)
    assert "contradict the capture's poses" in expected
    assert "contradict the capture's poses" in message


@pytest.fixture(scope="module")
def small_walk() -> Capture:
    return true_capture(width=128, height=96, frames=12, points=500)


@pytest.mark.parametrize("is_inverted", [False, True])
def test_poses_are_read_as_they_fit(call: Call, small_walk: Capture, is_inverted: bool) -> None:
    """Training has the right poses then, says so, and keeps the cloud unless the world is another one.

    Also where memory is full once depth is computed. Few matches are enough here, since the photographs are small.
    """
    script = (
        TYPED
        + OPEN_FINDER
        + """
        const { NoRoom } = await import(new URL("prior/stereo.js", location.href));
        const stereo = { release: () => {}, reserve: () => Promise.reject(new NoRoom("no depth here")) };
        const warnings = [];
        const listener = { onStage: async () => {}, onWarning: (text) => warnings.push(text) };
        const loaded = { train: framesOf(given.frames), heldOut: [], cloud: cloudOf(given.cloud), isMetric: false };
        const options = { gaussians: 500, seed: 0, prior: "dense", refines: true };
        Object.assign(settings.prior.poses.convention, { min_matches: 150 });
        const { capture } = await module.prepared(loaded, options, settings, { stereo, finder }, listener);
        device.destroy();
        const poses = capture.train.map(({ camera }) => camera.world_to_camera);
        return [poses, capture.cloud !== null, warnings, complaints];
    """
    )
    frames = small_walk.train[:3]
    mistake = np.linalg.inv if is_inverted else MISTAKES[1]
    wrong = [replace(frame, camera=misread(frame.camera, mistake)) for frame in frames]
    given = {"frames": plain_frames(wrong), "cloud": plain_cloud(small_walk.points)}
    poses, has_cloud, warnings, complaints = call("training/preparation.js", script, given)
    assert complaints == []
    assert has_cloud is not is_inverted
    kind = "inverted transforms" if is_inverted else "OpenGL's camera axes in place of OpenCV's, or the reverse"
    points = "points where the photographs agree" if is_inverted else "the capture's own points"
    assert warnings == [
        f"The photographs fit the poses only with {kind}: they are read so.",
        f"Depth is not computed: no depth here. Training starts from {points}.",
    ]
    first = np.linalg.inv(np.reshape(poses[0], (4, 4)))
    for frame, pose in zip(frames[1:], poses[1:], strict=True):
        expected = frame.camera.world_to_camera @ frames[0].camera.camera_to_world
        assert np.abs(np.reshape(pose, (4, 4)) @ first - expected).max() < 0.1
