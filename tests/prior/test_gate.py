"""Which frames become keyframes, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pocketgs.camera import Camera
from pocketgs.capture.capture import Capture, Frame
from pocketgs.errors import PocketGSError
from pocketgs.prior.gate import Decision, GateSettings, choose_keyframes
from pocketgs.prior.scale import Scale
from pocketgs.prior.tracks import view_distances

METRES = Scale(distance=2.0, unit=1.0)

CHECKERBOARD = np.indices((8, 8)).sum(axis=0) % 2


def frames_at(positions: Sequence[Sequence[float]] | np.ndarray, contrasts: Sequence[int] | np.ndarray) -> list[Frame]:
    """Frames that look along z from (x, y, 0), whose sharpness is in proportion to their contrast, 1 to 255."""
    frames = []
    for index, (position, contrast) in enumerate(zip(np.array(positions, float), contrasts, strict=True)):
        pose = np.eye(4)
        pose[: len(position), 3] = -position
        image = np.repeat((CHECKERBOARD * contrast).astype(np.uint8)[:, :, None], 3, axis=2)
        frames.append(Frame(f"{index:03d}.png", Camera(8, 8, 8.0, 8.0, 4.0, 4.0, pose), image))
    return frames


def along_a_line(spacings: np.ndarray) -> np.ndarray:
    """(N + 1, 1) positions."""
    return np.concatenate([[0.0], np.cumsum(spacings)])[:, None]


def kept(decisions: Sequence[Decision]) -> list[int]:
    return [index for index, decision in enumerate(decisions) if decision.kept]


def coverage(frames: Sequence[Frame], chosen: Sequence[int]) -> float:
    """How unlike the nearest chosen frame's view a frame's is at most."""
    cameras = [frame.camera for frame in frames]
    return float(view_distances(cameras, [cameras[index] for index in chosen], METRES.distance).min(axis=1).max())


def farthest_points(frames: Sequence[Frame], count: int) -> list[int]:
    """Frames that cover the others within twice the least possible distance (Gonzalez 1985)."""
    cameras = [frame.camera for frame in frames]
    apart = view_distances(cameras, cameras, METRES.distance)
    chosen = [0]
    while len(chosen) < count:
        chosen.append(int(apart[:, chosen].min(axis=1).argmax()))
    return chosen


@settings(max_examples=60, deadline=None)
@given(data=st.data(), count=st.integers(1, 60), most=st.integers(2, 12))
def test_every_frame_is_decided_on_and_the_bound_is_hard(data: st.DataObject, count: int, most: int) -> None:
    position = st.tuples(st.floats(-3, 3), st.floats(-3, 3))
    positions = data.draw(st.lists(position, min_size=count, max_size=count))
    contrasts = data.draw(st.lists(st.integers(0, 255), min_size=count, max_size=count))
    frames = frames_at(positions, contrasts)
    decisions = choose_keyframes(frames, METRES, GateSettings(max_keyframes=most))
    assert [decision.name for decision in decisions] == [frame.name for frame in frames]
    assert all(decision.reason for decision in decisions)
    assert 1 <= len(kept(decisions)) <= most


@settings(max_examples=60, deadline=None)
@given(contrasts=st.lists(st.integers(1, 255), min_size=2, max_size=50), most=st.integers(2, 4))
def test_a_frame_takes_the_place_of_another_only_if_clearly_sharper(contrasts: list[int], most: int) -> None:
    frames = frames_at(along_a_line(np.full(len(contrasts) - 1, 1.0)), contrasts)
    decisions = choose_keyframes(frames, METRES, GateSettings(max_keyframes=most, sharper=0.05))
    sharpness = {decision.name: decision.sharpness for decision in decisions}
    for decision in decisions:
        words = decision.reason.split()
        if decision.reason.endswith("is sharper"):
            assert sharpness[words[0]] > 1.05 * decision.sharpness
        elif decision.reason.startswith("not sharper than"):
            assert decision.sharpness <= 1.05 * sharpness[words[-1]]


@pytest.mark.parametrize(("contrast", "replaces"), [(90, False), (100, False), (104, False), (106, True), (200, True)])
def test_five_per_cent_decide_in_a_window(contrast: int, replaces: bool) -> None:
    contrasts = [100, contrast] * 6
    frames = frames_at(along_a_line(np.full(11, 1.0)), contrasts)
    decisions = choose_keyframes(frames, METRES, GateSettings(window=2, max_keyframes=2))
    losers = {index for index, decision in enumerate(decisions) if "sharper" in decision.reason}
    assert losers == set(range(0 if replaces else 1, 12, 2))
    assert all((index % 2 == 1) == replaces for index in kept(decisions))


def test_frames_near_the_last_keyframe_are_dropped() -> None:
    frames = frames_at([[0.0], [0.03], [0.049], [0.06], [0.08], [0.12]], [100, 255, 255, 100, 255, 100])
    decisions = choose_keyframes(frames, METRES, GateSettings(displacement=0.05))
    assert kept(decisions) == [0, 3, 5]
    for index, moved in ((1, 0.03), (2, 0.049), (4, 0.02)):
        assert decisions[index].displacement == pytest.approx(moved)
        assert decisions[index].reason == f"{moved:.3g} from the keyframe before"


def test_a_phone_that_stands_still_gives_one_keyframe() -> None:
    frames = frames_at(np.zeros((20, 1)), [100] * 20)
    assert kept(choose_keyframes(frames, METRES, GateSettings())) == [0]


def test_without_metres_displacement_is_a_share_of_the_distance() -> None:
    spacings = np.array([0.04, 0.07, 0.02, 0.2, 0.01])
    near = frames_at(along_a_line(spacings), [100] * 6)
    far = frames_at(1000 * along_a_line(spacings), [100] * 6)
    settings = GateSettings()
    expected = kept(choose_keyframes(near, Scale(1.0, 1.0), settings))
    assert len(expected) < 6
    assert kept(choose_keyframes(far, Scale(1000.0, 1000.0), settings)) == expected
    assert kept(choose_keyframes(far, Scale(1000.0, 1.0), settings)) == list(range(6))


@pytest.mark.parametrize("copy_first", [False, True])
def test_blurred_copies_are_not_chosen(copy_first: bool, small_capture: Capture) -> None:
    recorded, blurred = [], set()
    for frame in small_capture.train:
        copy = replace(frame, name=f"blurred {frame.name}", image=cv2.GaussianBlur(frame.image, (0, 0), 2))
        recorded += [copy, frame] if copy_first else [frame, copy]
        blurred.add(copy.name)
    decisions = choose_keyframes(recorded, METRES, GateSettings(max_keyframes=2))
    assert len(kept(decisions)) == 2
    assert not blurred & {decision.name for decision in decisions if decision.kept}


LINE = np.linspace(0.2, 0.25, 44)


@pytest.mark.parametrize("most", [2, 5, 15])
@pytest.mark.parametrize("contrasts", [range(100, 145), range(200, 155, -1), [100] * 45], ids=["up", "down", "equal"])
@pytest.mark.parametrize("spacings", [LINE, LINE[::-1], np.full(44, 0.2)], ids=["faster", "slower", "steady"])
def test_thinning_keeps_a_walk_covered(spacings: np.ndarray, contrasts: Sequence[int], most: int) -> None:
    frames = frames_at(along_a_line(spacings), contrasts)
    decisions = choose_keyframes(frames, METRES, GateSettings(window=1, max_keyframes=most))
    assert len(kept(decisions)) == most
    assert coverage(frames, kept(decisions)) <= 3 * coverage(frames, farthest_points(frames, most))


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), count=st.integers(10, 60), most=st.integers(2, 15))
def test_thinning_keeps_unordered_stills_covered(seed: int, count: int, most: int) -> None:
    rng = np.random.default_rng(seed)
    frames = frames_at(rng.uniform(-2, 2, (count, 2)), rng.integers(100, 255, count))
    decisions = choose_keyframes(frames, METRES, GateSettings(displacement=0.0, window=1, max_keyframes=most))
    assert len(kept(decisions)) == min(most, count)
    assert coverage(frames, kept(decisions)) <= 3 * coverage(frames, farthest_points(frames, most))


def test_the_sharper_of_two_like_views_stays() -> None:
    frames = frames_at([[0.0], [0.1], [1.0], [1.1], [2.0]], [100, 200, 200, 100, 100])
    decisions = choose_keyframes(frames, METRES, GateSettings(window=1, max_keyframes=3))
    assert kept(decisions) == [1, 2, 4]
    assert decisions[0].reason == "the view is covered by 001.png"
    assert decisions[3].reason == "the view is covered by 002.png"


def test_short_captures() -> None:
    assert choose_keyframes([], METRES, GateSettings()) == []
    (decision,) = choose_keyframes(frames_at([[0.0]], [100]), METRES, GateSettings())
    assert decision.kept


@pytest.mark.parametrize("most", [1, 0, -3])
def test_fewer_than_two_keyframes_are_refused(most: int) -> None:
    with pytest.raises(PocketGSError, match=f"found {most}, expected at least 2"):
        GateSettings(max_keyframes=most)
