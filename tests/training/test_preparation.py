"""Preparation: initial points of a run, for all options and captures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pocketgs import Capture, PocketGSError
from pocketgs.capture.capture import Frame
from pocketgs.capture.synthetic import true_capture
from pocketgs.geometry.camera import look_at
from pocketgs.prior.depth.cpu.stereo import CpuStereo
from pocketgs.prior.depth.depth_range import DepthRange
from pocketgs.prior.depth.sweep import DepthMap, SweepSettings
from pocketgs.prior.devices import create_devices
from pocketgs.system.stopwatch import Stopwatch
from pocketgs.training.options import SizedOptions, TrainingOptions
from pocketgs.training.preparation import MIN_POINTS, prepare, starting_points
from pocketgs.training.train import train


@pytest.fixture(scope="module")
def textured() -> Capture:
    """Large enough for features to be found."""
    return true_capture(160, 120, frames=12, points=1500)


def without_texture(capture: Capture, grey: int = 128) -> Capture:
    """The capture with uniform grey images."""
    even = [replace(frame, image=np.full_like(frame.image, grey)) for frame in capture.frames]
    count = len(capture.train)
    return replace(capture, train=even[:count], held_out=even[count:])


def test_without_a_prior_the_capture_is_taken_as_it_is(small_capture: Capture) -> None:
    prior = prepare(small_capture, TrainingOptions(prior="none"))
    assert prior.report is None
    assert prior.points is small_capture.points
    assert prior.frames == small_capture.frames


@pytest.mark.parametrize("mode", ["dense", "sparse"])
def test_prior_takes_the_place_of_the_captures_own_points(textured: Capture, mode: Any) -> None:
    stopwatch = Stopwatch()
    prior = prepare(textured, TrainingOptions(prior=mode, max_gaussians=3000, max_keyframes=6), stopwatch)
    assert prior.report is not None
    assert prior.points is not None
    if prior.report.points >= MIN_POINTS:
        assert prior.report.points == len(prior.points) <= 3000
        assert prior.points is not textured.points
        assert "points" not in stopwatch.seconds
    else:
        assert prior.points is textured.points
    assert mode == "sparse" or prior.report.points > 2500
    assert {"keyframes", "poses"} <= set(stopwatch.seconds)
    assert ({"depth", "fusion", "coverage"} <= set(stopwatch.seconds)) == (mode == "dense")
    assert (prior.report.coverage is not None) == (mode == "dense")
    assert sum(decision.kept for decision in prior.report.decisions) <= 6


def test_a_prior_that_finds_nothing_leaves_the_captures_own_points(textured: Capture) -> None:
    even = without_texture(textured)
    stopwatch = Stopwatch()
    prior = prepare(even, TrainingOptions(prior="sparse"), stopwatch)
    assert prior.points is textured.points
    assert prior.report is not None
    assert prior.report.points < MIN_POINTS
    assert prior.report.warnings
    assert "points" in stopwatch.seconds
    for frame, before in zip(prior.frames, even.frames, strict=True):
        assert frame.camera is before.camera


def test_where_there_are_no_points_at_all_some_are_drawn(textured: Capture) -> None:
    bare = replace(without_texture(textured), points=None)
    prior = prepare(bare, TrainingOptions(prior="sparse", max_gaussians=700))
    assert prior.points is not None
    assert 4 <= len(prior.points) <= 700


def test_options_reach_the_prior(textured: Capture) -> None:
    given = prepare(textured, TrainingOptions(prior="sparse", bundle=False, exposure="on", max_keyframes=4))
    assert given.report is not None
    assert not given.report.poses_refined
    assert given.report.gains is not None
    assert sum(decision.kept for decision in given.report.decisions) <= 4


def test_same_options_same_bits(textured: Capture) -> None:
    options = TrainingOptions(max_gaussians=2000, max_keyframes=4)
    clouds = [prepare(textured, options).points for _ in range(2)]
    assert clouds[0] is not None
    assert clouds[1] is not None
    assert clouds[0].positions.tobytes() == clouds[1].positions.tobytes()
    assert clouds[0].colours.tobytes() == clouds[1].colours.tobytes()


def test_cameras_that_look_apart_with_nothing_to_start_from(small_capture: Capture) -> None:
    """There is no texture, no point, and no common focus."""
    outwards = 2 * np.pi * np.arange(8) / 8
    frames = []
    for angle, frame in zip(outwards, small_capture.train, strict=False):
        direction = np.array([np.cos(angle), np.sin(angle), 0])
        pose = look_at(direction, 2 * direction, np.array([0, 0, 1.0]))
        frames.append(replace(frame, camera=replace(frame.camera, world_to_camera=pose)))
    apart = without_texture(replace(small_capture, train=frames, held_out=[], points=None))
    with pytest.raises(PocketGSError, match="cameras face outwards"):
        prepare(apart, TrainingOptions(prior="sparse"))


def test_starting_points_are_the_captures_own_as_far_as_they_may(small_capture: Capture) -> None:
    points = small_capture.points
    assert points is not None
    assert starting_points(small_capture, SizedOptions(max_gaussians=2000)) is points
    options = SizedOptions(max_gaussians=321)
    chosen = starting_points(small_capture, options)
    rows = {row.tobytes() for row in points.positions}
    assert all(row.tobytes() in rows for row in chosen.positions)
    assert len({row.tobytes() for row in chosen.positions}) == 321
    other = starting_points(small_capture, replace(options, seed=1))
    assert chosen.positions.tobytes() != other.positions.tobytes()


def test_a_prepared_capture_is_trained_with_the_number_that_training_is_given(small_capture: Capture) -> None:
    prepared = prepare(small_capture, TrainingOptions(prior="sparse"))
    assert prepared.points is not None
    assert len(prepared.points) > 50
    assert len(train(prepared, prior="sparse", iterations=1, max_gaussians=50).scene) == 50


def test_random_starting_points_leave_room_to_grow(small_capture: Capture) -> None:
    options = SizedOptions(recipe="3dgs-7k", strategy="adc", max_gaussians=1000)
    assert options.most_at_start < 1000
    assert len(starting_points(replace(small_capture, points=None), options)) == options.most_at_start


@pytest.mark.parametrize("count", [None, 0, 3])
def test_starting_points_are_drawn_where_there_are_too_few(small_capture: Capture, count: int | None) -> None:
    assert small_capture.points is not None
    few = None if count is None else small_capture.points.select(np.arange(count))
    assert len(starting_points(replace(small_capture, points=few), SizedOptions(max_gaussians=100))) == 100


@pytest.mark.parametrize("count", [1, 3])
def test_keyframes_are_swept_with_as_many_source_views_as_asked(textured: Capture, count: int) -> None:
    used = []

    class Watched(CpuStereo):
        def sweep(
            self, keyframe: Frame, source_views: Sequence[Frame], search: DepthRange, settings: SweepSettings
        ) -> DepthMap:
            used.append(len(source_views))
            return super().sweep(keyframe, source_views, search, settings)

    options = TrainingOptions(source_views=count, max_keyframes=3, max_gaussians=1000, engine="cpu")
    prepare(textured, options, devices=replace(create_devices(), stereo=Watched()))
    assert max(used) == count
