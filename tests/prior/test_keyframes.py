"""Keyframe selection: keyframes together cover the views, each part twice, and each adds something."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pocketgs.capture.capture import Capture, Frame
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera, look_at
from pocketgs.prior import keyframes
from pocketgs.prior.depth.source_views import LEAST_PARALLAX
from pocketgs.prior.keyframes import WIDEST_VIEWING_ANGLE, Decision, KeyframeSettings, select_keyframes

DISTANCE = 2.0
CHECKERBOARD = np.indices((8, 8)).sum(axis=0) % 2
IN_TWO = KeyframeSettings(views=2)
"""Every part is to be seen in two keyframes, which is easier to count than four."""

NO_POINTS = np.zeros((0, 3))


def frame_at(position: Sequence[float], contrast: int = 100, name: str = "") -> Frame:
    """A frame that looks along z from (x, y, z), a square as wide as it is far, as sharp as its contrast is high."""
    pose = np.eye(4)
    pose[: len(position), 3] = -np.array(position, float)
    image = np.repeat((CHECKERBOARD * contrast).astype(np.uint8)[:, :, None], 3, axis=2)
    return Frame(name or str(position), Camera(8, 8, 8.0, 8.0, 4.0, 4.0, pose), image)


def frames_at(positions: Sequence[Sequence[float]] | np.ndarray, contrasts: Sequence[int] | None = None) -> list[Frame]:
    contrasts = contrasts or [100] * len(positions)
    pairs = zip(positions, contrasts, strict=True)
    return [frame_at(position, contrast, f"{index:03d}.png") for index, (position, contrast) in enumerate(pairs)]


def walk(count: int, step: float) -> list[Frame]:
    return frames_at([[step * index] for index in range(count)])


def select(frames: Sequence[Frame], most: int = 100, **changes: float) -> list[Decision]:
    """Of frames that know nothing but the distance."""
    chosen = KeyframeSettings(**{"max_keyframes": most, "views": 2, **changes})  # type: ignore[arg-type]
    return select_keyframes(frames, [NO_POINTS] * len(frames), DISTANCE, chosen)


def kept(decisions: Sequence[Decision]) -> list[int]:
    return [index for index, decision in enumerate(decisions) if decision.kept]


def times_seen(frames: Sequence[Frame], chosen: Sequence[int], spots: int = 5) -> np.ndarray:
    """(F, S²) how many of the chosen frames have each of S x S spots of every frame in view, on the wall at `DISTANCE`.

    Only for frames that look along z from places at the same distance of the wall.
    """
    across = (np.arange(spots) + 0.5) / spots
    pixels = 8 * np.stack(np.meshgrid(across, across), axis=2).reshape(-1, 2)
    counts = []
    for frame in frames:
        spot = frame.camera.centre + DISTANCE * frame.camera.rays(pixels)
        inside = [
            np.all((where > 0) & (where < 8), axis=1)
            for where in (frames[index].camera.project(spot)[0] for index in chosen)
        ]
        counts.append(np.sum(inside, axis=0))
    return np.array(counts)


@settings(max_examples=25)
@given(data=st.data(), count=st.integers(1, 40), most=st.integers(2, 12))
def test_every_frame_is_decided_on_and_the_bound_is_hard(data: st.DataObject, count: int, most: int) -> None:
    position = st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 1))
    positions = data.draw(st.lists(position, min_size=count, max_size=count))
    contrasts = data.draw(st.lists(st.integers(0, 255), min_size=count, max_size=count))
    frames = frames_at(positions, contrasts)
    decisions = select(frames, most)
    assert [decision.name for decision in decisions] == [frame.name for frame in frames]
    assert all(decision.reason for decision in decisions)
    assert 1 <= len(kept(decisions)) <= most


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000), count=st.integers(2, 25))
def test_unordered_stills_are_covered_twice(seed: int, count: int) -> None:
    """Every part that two frames see at all is seen by two keyframes, wherever the frames stand."""
    frames = frames_at(np.random.default_rng(seed).uniform(-2, 2, (count, 2)))
    decisions = select(frames, least_gain=0.0)
    everybody, chosen = times_seen(frames, range(count)), times_seen(frames, kept(decisions))
    np.testing.assert_array_equal(np.minimum(chosen, 2), np.minimum(everybody, 2))


@pytest.mark.parametrize(("count", "step"), [(300, 0.1), (60, 0.02), (60, 0.4)])
def test_a_walk_is_covered_with_few(count: int, step: float) -> None:
    """As many frames as tile it twice, and not half as many again."""
    frames = walk(count, step)
    decisions = select(frames)
    needed = 2 * (1 + (count - 1) * step / DISTANCE)
    assert needed - 2 <= len(kept(decisions)) <= 1.5 * needed + 4
    assert np.mean(times_seen(frames, kept(decisions)) >= 2) > 0.9


def test_a_bound_that_is_too_low_is_spent_on_all_of_the_walk() -> None:
    """If not everything can be covered twice, no part is covered more often than needed."""
    frames = walk(120, 0.25)
    decisions = select(frames, most=12)
    assert len(kept(decisions)) == 12
    assert {each.reason for each in decisions if not each.kept} == {"others cover more, of at most 12"}
    # Six pairs, each two units wide but for what lies between its two, on 32 units.
    assert np.mean(times_seen(frames, kept(decisions)) >= 2) > 0.3


def test_of_many_frames_those_looked_at_are_spread_evenly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(keyframes, "MAX_VIEWS", 30)
    decisions = select(walk(200, 0.05))
    assert len(decisions) == 200
    nearest = np.abs(np.arange(200)[:, None] - kept(decisions)).min(axis=1)
    assert nearest.max() * 0.05 < DISTANCE
    reasons = [decision.reason for decision in decisions]
    assert reasons.count("not among the 30 considered") == 170
    assert reasons.count("what it sees is covered") == 30 - len(kept(decisions))


@pytest.mark.parametrize("copies", [2, 5, 20])
def test_duplicates_add_nothing(copies: int) -> None:
    """A phone that stands still gives one keyframe, and a slower walk gives no more."""
    assert len(kept(select(frames_at([[0.0]] * copies)))) == 1
    places = 0.0, 0.5, 1.0, 1.5
    once, often = (select(frames_at([[x] for x in places for _ in range(times)])) for times in (1, copies))
    assert [places[index // copies] for index in kept(often)] == [places[index] for index in kept(once)]


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e4])
def test_copies_are_views_that_no_baseline_tells_apart(scale: float) -> None:
    """Relative to the distance, not in metres."""
    for baseline, expected in ((0.9, [0]), (1.1, [0, 1])):
        frames = frames_at([[0.0], [scale * baseline * DISTANCE * LEAST_PARALLAX]])
        decisions = select_keyframes(frames, [NO_POINTS] * 2, scale * DISTANCE, IN_TWO)
        assert kept(decisions) == expected


@pytest.mark.parametrize("changed", ["turned", "wider", "closer"])
def test_views_from_one_place_that_show_something_else_are_no_copies(changed: str) -> None:
    first = frame_at([0.0])
    cameras = {
        "turned": replace(
            first.camera, world_to_camera=look_at(np.zeros(3), np.array([1.0, 0, 1]), np.array([0.0, -1, 0]))
        ),
        "wider": replace(first.camera, width=16, cx=8.0),
        "closer": replace(first.camera, fx=24.0, fy=24.0),
    }
    camera = cameras[changed]
    other = Frame("other", camera, cv2.resize(first.image, (camera.width, camera.height)))
    assert kept(select([first, other])) == [0, 1]


@pytest.mark.parametrize("copy_first", [False, True])
def test_blurred_copies_are_not_chosen(copy_first: bool, small_capture: Capture) -> None:
    recorded, blurred = [], set()
    for frame in small_capture.train:
        copy = replace(frame, name=f"blurred {frame.name}", image=cv2.GaussianBlur(frame.image, (0, 0), 2))
        recorded += [copy, frame] if copy_first else [frame, copy]
        blurred.add(copy.name)
    for most in (2, 3):
        decisions = select(recorded, most)
        assert len(kept(decisions)) == most
        assert not blurred & {decision.name for decision in decisions if decision.kept}


def test_the_sharper_of_two_like_views_is_chosen() -> None:
    decisions = select(frames_at([[0.0], [0.0], [5.0], [5.05], [5.0]], [100, 200, 200, 200, 100]))
    assert kept(decisions) == [1, 2, 3]
    assert decisions[1].sharpness == pytest.approx(2 * decisions[0].sharpness, rel=0.02)


def test_what_is_farther_away_is_covered_by_fewer() -> None:
    """Sparse points determine the distance to the wall, whatever the typical distance."""
    frames = walk(60, 0.1)
    counts = []
    for distance in (1.0, 4.0, 16.0):
        points = []
        for frame in frames:
            spread = np.stack(np.meshgrid(*2 * [np.linspace(-0.5, 0.5, 7)]), axis=2).reshape(-1, 2)
            points.append(frame.camera.centre + distance * np.column_stack([spread, np.ones(len(spread))]))
        counts.append(len(kept(select_keyframes(frames, points, DISTANCE, IN_TWO))))
    assert counts[0] > 2 * counts[1] >= 2 * counts[2] >= 4


def test_what_something_hides_is_covered_by_others() -> None:
    """Two frames see a board in front of the wall, two others the wall behind it: neither pair replaces the other."""
    spread = np.stack(np.meshgrid(*2 * [np.linspace(-0.5, 0.5, 9)]), axis=2).reshape(-1, 2)
    plane = np.column_stack([spread, np.ones(len(spread))])
    frames = frames_at([[0, 0, -5.0], [0.02, 0, -5.0], [0, 0, -2.6], [0.02, 0, -2.6]])
    board = 2.0 * plane + frames[0].camera.centre  # at z = -3, behind the nearer two
    wall = 2.6 * plane + frames[2].camera.centre  # at z = 0
    points = [board, board, wall, wall]
    assert kept(select_keyframes(frames, points, DISTANCE, IN_TWO)) == [0, 1, 2, 3]
    without_board = [5.0 * plane + frames[0].camera.centre] * 2 + [wall] * 2
    assert kept(select_keyframes(frames, without_board, DISTANCE, IN_TWO)) == [0, 1]


def test_what_is_seen_from_much_nearer_is_covered_from_there() -> None:
    """A wall from twice as far and a little more: pixels there are too coarse to replace the nearer views."""
    spread = np.stack(np.meshgrid(*2 * [np.linspace(-0.5, 0.5, 9)]), axis=2).reshape(-1, 2)
    plane = np.column_stack([spread, np.ones(len(spread))])
    for nearer, expected in ((2.4, [0, 1, 2, 3]), (2.6, [0, 1])):
        frames = frames_at([[0, 0, -5.0], [0.02, 0, -5.0], [0, 0, -nearer], [0.02, 0, -nearer]])
        points = [-frame.camera.centre[2] * plane + frame.camera.centre for frame in frames]
        assert kept(select_keyframes(frames, points, DISTANCE, IN_TWO)) == expected


def test_both_sides_of_a_thing_are_covered() -> None:
    """Cameras all around a point: surfaces seen from more than the widest angle apart need keyframes of their own."""
    frames = []
    for index, angle in enumerate(np.linspace(0, 2 * np.pi, 24, endpoint=False)):
        eye = DISTANCE * np.array([np.cos(angle), np.sin(angle), 0])
        pose = look_at(eye, np.zeros(3), np.array([0, 0, 1.0]))
        frames.append(replace(frame_at([0.0]), name=str(index), camera=Camera(8, 8, 20.0, 20.0, 4.0, 4.0, pose)))
    chosen = np.array(kept(select(frames)))
    gaps = np.diff(np.append(chosen, chosen[0] + 24)) * 2 * np.pi / 24
    assert gaps.max() <= 2 * WIDEST_VIEWING_ANGLE + 1e-6
    assert 2 * (2 * np.pi / (2 * WIDEST_VIEWING_ANGLE)) <= len(chosen) < 20


def test_masked_parts_need_no_keyframe() -> None:
    """Three frames see a wall; the fourth, which looks elsewhere, is masked completely, and the fifth by half."""
    frames = frames_at([[0.0], [0.0], [0.1], [9.0], [20.0]])
    frames[3] = replace(frames[3], mask=np.zeros((8, 8), bool))
    left = np.tile(np.arange(8) < 4, (8, 1))
    frames[4] = replace(frames[4], mask=left)
    assert 3 not in kept(select(frames))
    assert 4 in kept(select(frames))


def test_frames_that_are_masked_throughout() -> None:
    masked = [replace(frame, mask=np.zeros((8, 8), bool)) for frame in walk(5, 1.0)]
    assert 1 <= len(kept(select(masked))) <= 5


def test_frames_of_other_sizes() -> None:
    wide = replace(
        frame_at([0.0]), camera=Camera(16, 5, 8.0, 8.0, 8.0, 2.5, np.eye(4)), image=np.zeros((5, 16, 3), np.uint8)
    )
    frames = [replace(wide, name="wide"), *walk(3, 0.1)]
    assert kept(select(frames, least_gain=0.0))[0] == 0


def test_points_that_no_frame_can_see_do_no_harm() -> None:
    """Behind the camera, and on it."""
    frames = walk(4, 0.5)
    points = [frame.camera.centre + np.array([[0, 0, -1.0], [0, 0, 0]]) for frame in frames]
    assert kept(select_keyframes(frames, points, DISTANCE, IN_TWO)) == kept(select(frames))


@pytest.mark.parametrize("scale", [1e-4, 1e4])
def test_units_do_not_matter(scale: float) -> None:
    positions = np.random.default_rng(1).uniform(-2, 2, (20, 2))
    scaled = frames_at(scale * positions)
    found = select_keyframes(scaled, [NO_POINTS] * 20, scale * DISTANCE, IN_TWO)
    assert kept(found) == kept(select(frames_at(positions)))


def test_short_captures() -> None:
    assert select([]) == []
    (decision,) = select(walk(1, 1.0))
    assert decision.kept
    assert kept(select(walk(2, 1.0))) == [0, 1]


@pytest.mark.parametrize("most", [1, 0, -3])
def test_fewer_than_two_keyframes_are_refused(most: int) -> None:
    with pytest.raises(PocketGSError, match=f"found {most}, expected at least 2"):
        KeyframeSettings(max_keyframes=most)
