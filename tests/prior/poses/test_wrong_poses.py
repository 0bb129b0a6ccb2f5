"""Captures with wrong poses, unrelated photographs, and views without parallax."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from pocketgs.capture import Capture, Frame
from pocketgs.geometry.camera import Camera
from pocketgs.prior.features.cpu.finder import CpuFinder
from pocketgs.prior.features.features import DESCRIPTOR, Features
from pocketgs.prior.poses.relocalisation import Relocalisation
from pocketgs.prior.poses.structure import Structure, StructureSettings, build_structure
from pocketgs.prior.scale import estimate_scale
from prior.bundle_problem import make_problem, predicted, turned_and_moved

FRAMES = 12
SETTINGS = StructureSettings(features=1000)


def built(capture: Capture, frames: Sequence[Frame], settings: StructureSettings | None = None) -> Structure | None:
    return build_structure(frames, estimate_scale(capture), settings or SETTINGS)


def moved(frames: Sequence[Frame], which: Sequence[int], metres: float) -> list[Frame]:
    """Frames, some of which state poses so far off, each in another direction."""
    rng = np.random.default_rng(0)
    result = list(frames)
    for index in which:
        direction = rng.normal(size=3)
        camera = turned_and_moved(frames[index].camera, np.zeros(3), metres * direction / np.linalg.norm(direction))
        result[index] = replace(frames[index], camera=camera)
    return result


def offsets(cameras: Sequence[Camera], frames: Sequence[Frame]) -> np.ndarray:
    """(F,) distances of cameras from the frames' true ones."""
    return np.array([np.linalg.norm(a.centre - b.camera.centre) for a, b in zip(cameras, frames, strict=True)])


@pytest.mark.parametrize("metres", [0.5, 5.0])
def test_wrong_poses_are_found_and_mended(clean_walk: Capture, metres: float) -> None:
    wrong = [2, 6, 10]
    structure = built(clean_walk, moved(clean_walk.frames, wrong, metres))
    assert structure is not None
    names = {clean_walk.frames[index].name for index in wrong}
    assert set(structure.replaced) | set(structure.unplaced) == names
    assert structure.refined
    assert not structure.adjusted
    mended = [name not in structure.unplaced for name in structure.names]
    assert sum(mended) >= FRAMES - 1
    assert offsets(structure.cameras, clean_walk.frames)[mended].max() < 0.02


def test_wrong_poses_that_may_not_move_are_named(clean_walk: Capture) -> None:
    frames = moved(clean_walk.frames, [4, 9], 1.0)
    structure = built(clean_walk, frames, replace(SETTINGS, bundle=False))
    assert structure is not None
    assert set(structure.unplaced) == {frames[4].name, frames[9].name}
    assert not structure.refined
    assert [camera is frame.camera for camera, frame in zip(structure.cameras, frames, strict=True)] == [True] * FRAMES


def test_half_the_poses_wrong(clean_walk: Capture) -> None:
    wrong = list(range(0, FRAMES, 2))
    structure = built(clean_walk, moved(clean_walk.frames, wrong, 0.2))
    assert structure is not None
    kept = [name not in structure.unplaced for name in structure.names]
    assert sum(kept) >= FRAMES - 2
    assert np.median(offsets(structure.cameras, clean_walk.frames)[kept]) < 0.02


def test_a_group_that_agrees_only_with_itself(clean_walk: Capture) -> None:
    """Consecutive frames that are all moved together agree with each other only."""
    turn, offset = np.array([0.0, 0.3, 0.0]), np.array([1.0, 0.0, 0.5])
    order = np.argsort([frame.name for frame in clean_walk.frames])
    group = [int(order[place]) for place in range(4, 7)]
    frames = [
        replace(frame, camera=turned_and_moved(frame.camera, turn, offset)) if index in group else frame
        for index, frame in enumerate(clean_walk.frames)
    ]
    structure = built(clean_walk, frames)
    assert structure is not None
    assert set(structure.replaced) | set(structure.unplaced) == {frames[index].name for index in group}


def test_a_photograph_of_another_place(clean_walk: Capture) -> None:
    frames = list(clean_walk.frames)
    frames[6] = replace(frames[6], image=np.ascontiguousarray(frames[6].image[:, ::-1]))
    structure = built(clean_walk, frames)
    assert structure is not None
    assert structure.unplaced == (frames[6].name,)
    assert offsets(structure.cameras, clean_walk.frames).max() == 0


def test_duplicate_frames(clean_walk: Capture) -> None:
    frames = [*clean_walk.frames, *(replace(frame, name=f"again/{frame.name}") for frame in clean_walk.frames[:5])]
    structure = built(clean_walk, frames)
    assert structure is not None
    assert structure.unplaced == structure.replaced == ()
    assert not structure.refined


def test_two_frames(clean_walk: Capture) -> None:
    structure = built(clean_walk, clean_walk.frames[4:6])
    assert structure is not None
    assert not structure.unplaced


def test_turning_on_the_spot_tells_no_depth(clean_walk: Capture) -> None:
    first = clean_walk.frames[0]
    spot = [replace(first, name=f"{turn}.png") for turn in range(6)]
    assert built(clean_walk, spot) is None


def test_a_blank_wall(clean_walk: Capture) -> None:
    blank = [replace(frame, image=np.full_like(frame.image, 200)) for frame in clean_walk.frames]
    assert built(clean_walk, blank) is None


@pytest.mark.parametrize(("share", "placed"), [(0.8, True), (0.5, False)])
def test_a_view_is_placed_only_where_most_of_it_fits(share: float, placed: bool) -> None:
    """What stands twice in a room gives enough matches for a place, which all others contradict."""
    problem = make_problem(frames=8, points=200, views=8)
    views, rng = len(problem.true_cameras), np.random.default_rng(0)
    order = np.lexsort((problem.observations.point, problem.observations.frame))
    pixels = predicted(problem.true_cameras, problem.true_points, problem.observations.select(order))
    pixels = pixels.reshape(views, -1, 2)
    twins = rng.permutation(len(problem.true_points))[round(share * len(problem.true_points)) :]
    pixels[-1, twins] = rng.uniform((0, 0), (640, 480), (len(twins), 2))
    descriptors = rng.normal(size=(len(problem.true_points), DESCRIPTOR)).astype(np.float32)
    features = [Features(seen, descriptors) for seen in pixels]
    same = np.tile(np.arange(len(problem.true_points))[:, None], 2)
    wrong = np.arange(views) == views - 1
    cameras = [*problem.true_cameras[:-1], turned_and_moved(problem.true_cameras[-1], np.zeros(3), np.full(3, 2.0))]
    matches = {pair: same for pair in combinations(range(views), 2)}
    found = Relocalisation(cameras, features, matches, wrong, 2.0, 4.0, CpuFinder())
    found.run()
    assert found.wrong.any() != placed
    if placed:
        np.testing.assert_allclose(found.cameras[-1].centre, problem.true_cameras[-1].centre, atol=1e-3)
