"""The page's relocalisation of wrong poses: poses from points alone, and photographs that are placed anew."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pocketgs.capture.open import open_capture
from pocketgs.geometry.camera import Camera
from pocketgs.prior.features.observations import Observations
from pocketgs.prior.poses.absolute_pose import MIN_OBSERVATIONS, pose_from_points
from pocketgs.prior.poses.structure import StructureSettings, build_structure
from pocketgs.prior.poses.support import well_supported
from pocketgs.prior.scale import Scale, estimate_scale
from prior.bundle_problem import turned_and_moved
from static_site.given import OPEN_FINDER, TYPED, plain, plain_frames

Call = Callable[..., Any]


@pytest.fixture
def camera() -> Camera:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix()
    pose[:3, 3] = [0.4, -1.0, 3.0]
    return Camera(width=320, height=240, fx=260.0, fy=250.0, cx=155.0, cy=123.0, world_to_camera=pose)


def seen_points(camera: Camera, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """(M, 3) points at different depths all over the image, and (M, 2) their pixels."""
    pixels = rng.uniform((0, 0), (camera.width, camera.height), (count, 2))
    return camera.centre + camera.rays(pixels) * rng.uniform(2, 6, (count, 1)), pixels


def test_roots(call: Call) -> None:
    """Of (x - 1) (x - 2) (x - 2.5) (x - 9), between 1.5 and 10, and of polynomials that have none there."""
    script = "return given.map(([coefficients, low, high]) => module.rootsBetween(coefficients, low, high));"
    quartic = np.polynomial.polynomial.polyfromroots([1, 2, 2.5, 9]).tolist()
    found = call("numbers/roots.js", script, [[quartic, 1.5, 10], [[1, 0, 1], -5, 5], [[3], 0, 1]])
    np.testing.assert_allclose(found[0], [2, 2.5, 9], atol=1e-9)
    assert found[1:] == [[], []]


def test_poses_of_three_points(call: Call, camera: Camera) -> None:
    """One of the poses is the camera's, and from all of them the points are seen where they are. Points on a line, or
    one point twice, tell none.
    """
    script = "return given.map(([points, rays]) => module.posesOfThree(points, rays));"
    rng, given, points = np.random.default_rng(0), [], []
    for _ in range(50):
        three, _ = seen_points(camera, 3, rng)
        points.append(three)
        given.append([three.tolist(), unit_rays(camera, three).tolist()])
    for flat in (points[0][[0, 0, 1]], points[0][0] + np.array([[0, 0, 0], [1, 0, 0], [3, 0, 0]]) / 8):
        given.append([flat.tolist(), unit_rays(camera, flat).tolist()])
    *found, twice, line = call("prior/poses/three_points.js", script, given)
    assert twice == line == []
    for poses, three in zip(found, points, strict=True):
        assert 1 <= len(poses) <= 4
        cameras = [replace(camera, world_to_camera=np.reshape(pose, (4, 4))) for pose in poses]
        assert min(np.abs(one.world_to_camera - camera.world_to_camera).max() for one in cameras) < 1e-6
        for one in cameras:
            np.testing.assert_allclose(unit_rays(one, three), unit_rays(camera, three), atol=1e-6)
            np.testing.assert_allclose(np.linalg.det(one.world_to_camera[:3, :3]), 1, atol=1e-9)


def unit_rays(camera: Camera, points: np.ndarray) -> np.ndarray:
    """(N, 3) directions of points in the camera's axes."""
    seen = points @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
    return np.asarray(seen / np.linalg.norm(seen, axis=1, keepdims=True))


def test_support(call: Call, camera: Camera) -> None:
    script = """
        const observations = { frame: Int32Array.from(given.frame), pixels: Float64Array.from(given.pixels) };
        return module.wellSupported(given.cameras, observations, 20, settings.prior.poses);
    """
    rng = np.random.default_rng(0)
    cameras = [replace(camera, width=width) for width in range(100, 500, 10)]
    counts, shares = rng.integers(0, 45, len(cameras)), rng.uniform(0, 1, len(cameras))
    frame = np.repeat(np.arange(len(cameras)), counts)
    sizes = np.array([(camera.width, camera.height) for camera in cameras])
    # Some just beyond the border, as of undistorted photographs.
    pixels = rng.uniform(-0.01, 1.01 * shares[frame, None], (len(frame), 2)) * sizes[frame]
    given = {
        "cameras": [plain(camera) for camera in cameras],
        "frame": frame.tolist(),
        "pixels": pixels.reshape(-1).tolist(),
    }
    expected = well_supported(cameras, Observations(frame, np.arange(len(frame)), pixels), 20)
    assert call("prior/poses/support.js", script, given) == expected.tolist()
    assert (counts >= 20).sum() > expected.sum() > 5


@pytest.mark.parametrize(
    ("wrong", "spread", "count"), [(0.0, 1.0, 40), (0.7, 1.0, 300), (0.3, 0.2, 300), (0.0, 1.0, MIN_OBSERVATIONS - 1)]
)
def test_absolute_pose(call: Call, camera: Camera, wrong: float, spread: float, count: int) -> None:
    """Without an initial pose, though some observations are wrong; None for too few, and for those in one corner."""
    script = """
        const [points, pixels] = [given.points, given.pixels].map((values) => Float64Array.from(values));
        const found = module.poseFromPoints(given.camera, { points, pixels }, 2, settings.prior);
        return found && found.world_to_camera;
    """
    rng = np.random.default_rng(0)
    points, pixels = seen_points(camera, count, rng)
    near = (pixels < spread * np.array([camera.width, camera.height])).all(axis=1)
    points, pixels = points[near], pixels[near] + rng.normal(0, 0.3, (near.sum(), 2))
    stray = rng.random(len(pixels)) < wrong
    pixels[stray] = rng.uniform(0, 1, (stray.sum(), 2)) * pixels.max(axis=0)
    lost = replace(camera, world_to_camera=np.eye(4))
    expected = pose_from_points(lost, points, pixels, 2.0)
    given = {"camera": plain(lost), "points": points.reshape(-1).tolist(), "pixels": pixels.reshape(-1).tolist()}
    found = call("prior/poses/absolute_pose.js", script, given)
    if spread < 1 or count < MIN_OBSERVATIONS:
        assert found is expected is None
        return
    assert expected is not None
    np.testing.assert_allclose(np.reshape(found, (4, 4)), expected.world_to_camera, atol=1e-4)
    np.testing.assert_allclose(expected.world_to_camera, camera.world_to_camera, atol=0.02)


def test_fern_with_wrong_poses(call: Call, data_folder: Path) -> None:
    """Two of five real photographs state poses far off: the page places them as Python does, from its own features.

    They are turned by 40 degrees and moved by half the distance to the scene.
    """
    capture = open_capture(data_folder / "fern", images="images_4", max_size=200)
    scale, rng, true = estimate_scale(capture), np.random.default_rng(0), capture.train[:5]
    wrong, frames = [1, 3], list(true)
    for index in wrong:
        turn, offset = (one / np.linalg.norm(one) for one in rng.normal(size=(2, 3)))
        moved = turned_and_moved(frames[index].camera, np.radians(40) * turn, scale.distance / 2 * offset)
        frames[index] = replace(frames[index], camera=moved)
    script = (
        TYPED
        + OPEN_FINDER
        + """
        const [frames, onStage] = [framesOf(given.frames), async () => {}];
        const found = await module.buildStructure(frames, given.scale, settings.prior, finder, onStage);
        device.destroy();
        const { cameras, replaced, unplaced, isAdjusted } = found;
        return [cameras.map(({ world_to_camera: m }) => m), replaced, unplaced, isAdjusted, complaints];
    """
    )
    given = {"frames": plain_frames(frames), "scale": {"distance": scale.distance, "unit": scale.unit}}
    poses, replaced, unplaced, is_adjusted, complaints = call("prior/poses/structure.js", script, given)
    expected = build_structure(frames, scale, StructureSettings())
    assert complaints == []
    assert np.flatnonzero(replaced).tolist() == wrong
    assert not any(unplaced)
    assert not is_adjusted
    assert expected is not None
    assert expected.replaced == tuple(frames[index].name for index in wrong)
    assert not expected.adjusted
    for index, (frame, pose) in enumerate(zip(frames, poses, strict=True)):
        camera = replace(frame.camera, world_to_camera=np.reshape(pose, (4, 4)))
        if index not in wrong:
            np.testing.assert_array_equal(camera.world_to_camera, frame.camera.world_to_camera)
            continue
        degrees, share = apart(camera, expected.cameras[index], scale)
        assert degrees < 0.2
        assert share < 0.004
        degrees, share = apart(camera, true[index].camera, scale)
        assert degrees < 0.5
        assert share < 0.01


def apart(one: Camera, other: Camera, scale: Scale) -> tuple[float, float]:
    """The angle between two cameras in degrees, and the distance as a share of that to the scene."""
    turn = Rotation.from_matrix(one.world_to_camera[:3, :3] @ other.world_to_camera[:3, :3].T).magnitude()
    return float(np.degrees(turn)), float(np.linalg.norm(one.centre - other.centre)) / scale.distance
