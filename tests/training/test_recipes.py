"""Recipes: schedules of learning rates, and units of length."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import get_args

import numpy as np
import pytest

from pocketgs import Camera, Capture, PocketGSError, PointCloud
from pocketgs.geometry.camera import look_at
from pocketgs.splat.settings import LearningRates
from pocketgs.training import recipes
from pocketgs.training.options import SizedOptions
from pocketgs.training.recipes import (
    RECIPES,
    RecipeName,
    camera_extent,
    cosine,
    exponential_means,
    pixel_footprint,
    recipe_named,
)
from pocketgs.training.train import train

RATES = LearningRates(means=1.0, log_scales=2.0, rotations=3.0, opacity_logits=4.0, sh_dc=5.0, sh_rest=6.0)


def camera_at(*centre: float, focal: float = 100.0) -> Camera:
    """A camera that looks along z, 80 x 60 pixels."""
    pose = np.eye(4)
    pose[:3, 3] = -np.array(centre)
    return Camera(80, 60, focal, focal, 40.0, 30.0, pose)


def cloud(*positions: tuple[float, float, float]) -> PointCloud:
    return PointCloud(np.array(positions), np.zeros((len(positions), 3)))


@pytest.mark.parametrize(("progress", "factor"), [(0.0, 1.0), (0.5, 0.55), (1.0, 0.1), (1.5, 0.1)])
def test_cosine_scales_all_rates(progress: float, factor: float) -> None:
    found = cosine(final=0.1)(RATES, progress)
    for field in fields(RATES):
        assert getattr(found, field.name) == pytest.approx(factor * getattr(RATES, field.name))


@pytest.mark.parametrize(("progress", "factor"), [(0.0, 1.0), (0.5, 0.1), (1.0, 0.01), (1.5, 0.01)])
def test_exponential_scales_the_rate_of_the_means_only(progress: float, factor: float) -> None:
    found = exponential_means(final=0.01)(RATES, progress)
    assert found.means == pytest.approx(factor)
    assert replace(found, means=RATES.means) == RATES


@pytest.mark.parametrize("name", list(RECIPES))
def test_recipes_are_sound(name: str) -> None:
    recipe = recipe_named(name)
    assert recipe.name == name
    assert 0 < recipe.opacity < 1
    assert recipe.sh_degree in range(4)
    for progress in np.linspace(0, 1, 11):
        rates = recipe.schedule(recipe.rates, float(progress))
        for field in fields(rates):
            assert 0 < getattr(rates, field.name) <= getattr(recipe.rates, field.name)


def test_every_name_is_that_of_a_recipe() -> None:
    assert tuple(RECIPES) == get_args(RecipeName)


def test_unknown_recipe() -> None:
    with pytest.raises(PocketGSError, match="recipe 'fast': not known, expected one of pocketgs, reference"):
        recipe_named("fast")


def test_pixel_footprint_is_depth_over_focal_length() -> None:
    points = cloud((0, 0, 2), (0, 0, 3), (0.1, 0, 4))
    assert pixel_footprint([camera_at(0, 0, 0)], points) == pytest.approx(0.03)
    assert pixel_footprint([camera_at(0, 0, 0, focal=200)], points) == pytest.approx(0.015)
    # The median is over all cameras' views of points together.
    assert pixel_footprint([camera_at(0, 0, 0), camera_at(0, 0, -2)], points) == pytest.approx(0.04)


def test_pixel_footprint_counts_visible_points_only() -> None:
    """Points behind the camera and beside its image are ignored."""
    points = cloud((0, 0, 2), (0, 0, -50), (0, 0, -60), (30, 0, 40), (0, -30, 40))
    assert pixel_footprint([camera_at(0, 0, 0)], points) == pytest.approx(0.02)


def test_pixel_footprint_of_pixels_that_are_not_square() -> None:
    camera = replace(camera_at(0, 0, 0), fx=50.0, fy=200.0)
    assert pixel_footprint([camera], cloud((0, 0, 3))) == pytest.approx(0.03)


def test_pixel_footprint_of_many_points_needs_little_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 1,000 points at the same places as ten, 100 or fewer are projected."""
    monkeypatch.setattr(recipes, "MOST_DEPTHS", 100)
    places = [(0, 0, depth) for depth in range(1, 11)]
    many, few = cloud(*(place for place in places for _ in range(100))), cloud(*places)
    assert pixel_footprint([camera_at(0, 0, 0)], many) == pytest.approx(
        pixel_footprint([camera_at(0, 0, 0)], few), rel=0.1
    )


def test_pixel_footprint_where_nothing_is_seen() -> None:
    with pytest.raises(PocketGSError, match="none of the 2 cameras sees any of the 1 points"):
        pixel_footprint([camera_at(0, 0, 0), camera_at(1, 0, 0)], cloud((0, 0, -1)))


def test_pixel_footprint_is_a_pixel(small_capture: Capture) -> None:
    """A sideways step of that length moves most points by about a pixel."""
    assert small_capture.points is not None
    cameras = [frame.camera for frame in small_capture.train]
    length = pixel_footprint(cameras, small_capture.points)
    positions = small_capture.points.positions.astype(np.float64)
    before, _ = cameras[0].project(positions)
    after, _ = cameras[0].project(positions + length * cameras[0].world_to_camera[0, :3])
    assert np.median(np.abs(after - before).sum(axis=1)) == pytest.approx(1.0, abs=0.2)


def test_camera_extent_is_that_of_3dgs() -> None:
    cameras = [camera_at(x, 0, 0) for x in (-1.0, -1.0, 0.0, 2.0)]
    assert camera_extent(cameras, cloud((0, 0, 5))) == pytest.approx(1.1 * 2)


def test_camera_extent_of_cameras_in_one_place() -> None:
    """It is an error: steps of length zero would silently train nothing."""
    eye = np.array([3.0, -1.0, 2.0])
    panorama = [
        Camera(80, 60, 50.0, 50.0, 40.0, 30.0, look_at(eye, eye + direction, np.eye(3)[2]))
        for direction in np.random.default_rng(0).normal(size=(12, 3))
    ]
    for cameras in ([camera_at(1, 2, 3)], [camera_at(1, 2, 3)] * 5, panorama):
        with pytest.raises(PocketGSError, match=r"training cameras \(\d+\) stand in one place.*recipe 'pocketgs'"):
            camera_extent(cameras, cloud((0, 0, 5), (1, 1, 9)))
    # However little they move, that is a length.
    nearby = [camera_at(0, 0, 0), camera_at(2e-3, 0, 0)]
    assert camera_extent(nearby, cloud((0, 0, 5))) == pytest.approx(1.1e-3)


@pytest.mark.parametrize(("iterations", "slower"), [(1, 1.0), (500, 1.0), (1000, 0.5**0.5), (2000, 0.5), (30_000, 0.5)])
def test_scales_learn_more_slowly_in_longer_runs(iterations: int, slower: float) -> None:
    recipe = recipe_named("pocketgs")
    rates = recipe.rates_for(iterations, unit=3.0)
    assert rates.log_scales == pytest.approx(slower * recipe.rates.log_scales)
    assert replace(rates, log_scales=recipe.rates.log_scales) == replace(recipe.rates, means=3.0 * recipe.rates.means)
    reference = recipe_named("reference")
    assert reference.rates_for(iterations, unit=3.0).log_scales == reference.rates.log_scales


def test_scales_learn_as_in_a_run_of_the_length_that_time_allows(
    small_capture: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    lengths: list[int] = []
    rates_for = recipes.Recipe.rates_for

    def note(recipe: recipes.Recipe, iterations: int, unit: float) -> LearningRates:
        lengths.append(iterations)
        return rates_for(recipe, iterations, unit)

    monkeypatch.setattr(recipes.Recipe, "rates_for", note)
    for expected in (None, 1):
        train(small_capture, SizedOptions(iterations=2, prior="none", max_gaussians=50, expected_iterations=expected))
    assert lengths == [2, 1]
