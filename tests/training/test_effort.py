"""Effort: the sizes chosen for a capture, independent of the machine."""

from __future__ import annotations

import os
from dataclasses import replace

import numba
import psutil
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from pocketgs import Capture, PocketGSError, train
from pocketgs.system import cores
from pocketgs.training.options import SizedOptions, TrainingOptions
from pocketgs.training.planning.effort import (
    FEWEST_GAUSSIANS,
    MAX_EPOCHS,
    MAX_ITERATIONS,
    MAX_SECONDS,
    MIN_ITERATIONS,
    MIN_SECONDS,
    MOST_GAUSSIANS,
    STANDARD_KEYFRAMES,
    sized,
)
from pocketgs.training.planning.time_model import step_seconds

SIDES = st.integers(16, 6000)
COUNTS = st.integers(1, 1000)
FERN = [(498, 372)] * 17
PHONE = [(800, 600)] * 150


def sizes(options: TrainingOptions) -> tuple[int | None, int | None, int | None]:
    return options.iterations, options.max_gaussians, options.max_keyframes


def seconds(options: SizedOptions, views: list[tuple[int, int]]) -> float:
    """Training time on the machine that the time model was measured on, with spherical harmonics of degree 2."""
    pixels = sum(width * height for width, height in views) / len(views)
    return options.iterations * step_seconds(options.max_gaussians, 9, pixels)


@given(SIDES, SIDES, COUNTS)
def test_quick_is_the_same_for_every_capture(width: int, height: int, count: int) -> None:
    assert sizes(sized(TrainingOptions(effort="quick"), [(width, height)] * count)) == (500, 50_000, 40)


def test_standard_is_the_default_and_what_sizes_are_bounded_by() -> None:
    assert TrainingOptions() == TrainingOptions(effort="standard")
    assert sizes(TrainingOptions()) == (None, None, None)
    many = [(40, 30)] * 1000
    small, large = sized(TrainingOptions(), many), sized(TrainingOptions(), [(4000, 3000)] * 500)
    assert small.max_gaussians == FEWEST_GAUSSIANS
    assert MIN_SECONDS - 0.1 < seconds(small, many) <= MIN_SECONDS
    assert sized(TrainingOptions(max_gaussians=1000), many).iterations == MAX_ITERATIONS
    assert sized(TrainingOptions(), many[:20]).iterations == 20 * MAX_EPOCHS
    assert sized(TrainingOptions(), many[:3]).iterations == MIN_ITERATIONS
    assert large.max_gaussians == MOST_GAUSSIANS
    assert large.iterations == MIN_ITERATIONS


@given(SIDES, SIDES, COUNTS, COUNTS)
def test_standard_grows_with_the_number_of_photographs(width: int, height: int, count: int, more: int) -> None:
    smaller, larger = (sized(TrainingOptions(), [(width, height)] * views) for views in (count, count + more))
    assert smaller.max_gaussians <= larger.max_gaussians
    assert smaller.max_keyframes <= larger.max_keyframes
    # Whole numbers of Gaussians cost a step at most.
    assert smaller.iterations <= larger.iterations + 1


@given(SIDES, SIDES, COUNTS, st.integers(1, 4))
def test_standard_grows_with_the_size_of_photographs(width: int, height: int, count: int, times: int) -> None:
    views, enlarged = [(width, height)] * count, [(times * width, times * height)] * count
    smaller, larger = sized(TrainingOptions(), views), sized(TrainingOptions(), enlarged)
    assert smaller.max_gaussians <= larger.max_gaussians
    assert seconds(smaller, views) <= seconds(larger, enlarged) + step_seconds(MOST_GAUSSIANS, 9, 1e8)


def test_standard_takes_the_time_that_it_should() -> None:
    """One minute minus preparation for a small capture; five minutes minus preparation for 150 photographs."""
    for views, least, most in ((FERN, 20.0, 40.0), (PHONE, 150.0, MAX_SECONDS)):
        options = sized(TrainingOptions(), views)
        assert least <= seconds(options, views) <= most
    assert sized(TrainingOptions(), FERN).max_gaussians < 55_000
    assert sized(TrainingOptions(), PHONE).max_gaussians == MOST_GAUSSIANS
    assert sized(TrainingOptions(), PHONE).max_keyframes == STANDARD_KEYFRAMES


@given(SIDES, SIDES, COUNTS)
@example(400, 400, 87)
def test_best_is_never_shorter_than_standard(width: int, height: int, count: int) -> None:
    views = [(width, height)] * count
    best, standard = sized(TrainingOptions(effort="best"), views), sized(TrainingOptions(), views)
    assert min(best.least_iterations, best.iterations) >= standard.iterations


def test_photographs_of_different_sizes_count_by_their_pixels() -> None:
    mixed = sized(TrainingOptions(), [(400, 300)] * 60 + [(800, 600)] * 60)
    alike = sized(TrainingOptions(), [(400, 300)] * 60 + [(600, 800)] * 60)
    assert mixed == alike
    assert sized(TrainingOptions(), [(400, 300)] * 120).max_gaussians < mixed.max_gaussians


@pytest.mark.parametrize("effort", ["quick", "standard"])
@given(
    st.none() | st.integers(1, 10_000),
    st.none() | st.integers(4, 10**6),
    st.none() | st.integers(2, 500),
)
def test_the_users_numbers_win(
    effort: str, iterations: int | None, gaussians: int | None, keyframes: int | None
) -> None:
    asked = TrainingOptions(
        effort=effort,  # type: ignore[arg-type]
        iterations=iterations,
        max_gaussians=gaussians,
        max_keyframes=keyframes,
        seed=5,
        sh_degree=1,
        time_budget=77.0,
        max_memory=1234,
    )
    found = sized(asked, PHONE)
    for given_size, size in zip(sizes(asked), sizes(found), strict=True):
        assert size is not None
        assert given_size is None or size == given_size
    assert (found.effort, found.seed, found.sh_degree, found.time_budget, found.max_memory) == (
        effort,
        5,
        1,
        77.0,
        1234,
    )
    assert sized(found, FERN) is found


def test_fewer_gaussians_leave_time_for_more_iterations() -> None:
    counts = (10_000, 100_000, 400_000)
    iterations = [sized(TrainingOptions(max_gaussians=count), PHONE).iterations for count in counts]
    assert iterations == sorted(iterations, reverse=True)
    assert iterations[0] > iterations[-1]


def test_every_machine_gives_the_same_sizes(monkeypatch: pytest.MonkeyPatch) -> None:
    """The number of cores, the memory and the speed of the machine are not queried."""
    here = sized(TrainingOptions(), PHONE)

    def asked(*_: object, **__: object) -> None:
        raise AssertionError("the machine was looked at")

    for module, name in (
        (os, "cpu_count"),
        (psutil, "virtual_memory"),
        (cores, "usable_cores"),
        (numba, "get_num_threads"),
    ):
        monkeypatch.setattr(module, name, asked)
    assert sized(TrainingOptions(), PHONE) == here
    for options in (TrainingOptions(threads=1), TrainingOptions(threads=64), TrainingOptions(engine="webgpu")):
        assert sizes(sized(options, PHONE)) == sizes(here)


def test_an_effort_that_there_is_not_is_refused() -> None:
    with pytest.raises(PocketGSError, match="effort: found slow, expected quick, standard or best"):
        TrainingOptions(effort="slow")  # type: ignore[arg-type]


def test_training_in_python_is_sized_as_well(small_capture: Capture) -> None:
    """The default for a capture this small has as many Gaussians as points, and ends by the clock."""
    scene = train(small_capture, prior="none", time_budget=0.5, evaluate_every=0).scene
    assert small_capture.points is not None
    assert len(scene) == len(small_capture.points)
    with pytest.raises(PocketGSError, match="effort: found slow"):
        train(small_capture, TrainingOptions(), effort="slow")


def test_sized_options_are_those_of_quick_if_nothing_is_said() -> None:
    assert sized(TrainingOptions(effort="quick"), FERN) == replace(SizedOptions(), effort="quick")
