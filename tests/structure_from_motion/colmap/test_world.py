"""The world of posed photographs: metres by GPS, upright however cameras are held."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pocketgs.geometry.up_direction import up_direction
from pocketgs.structure_from_motion.colmap.world import (
    MEDIAN_DISTANCE,
    Similarity,
    from_places,
    similarity,
    upright,
)
from pocketgs.structure_from_motion.gps import local_metres

seeds = st.integers(0, 2**32 - 1)


def random_rotation(generator: np.random.Generator) -> np.ndarray:
    q, r = np.linalg.qr(generator.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def looking(headings: np.ndarray, pitches: np.ndarray) -> np.ndarray:
    """(N, 3, 3) world to level cameras in a world with y down; headings about the vertical, pitches upwards."""
    forward = np.stack(
        [np.sin(headings) * np.cos(pitches), -np.sin(pitches), np.cos(headings) * np.cos(pitches)], axis=1
    )
    right = np.stack([np.cos(headings), np.zeros_like(headings), -np.sin(headings)], axis=1)
    return np.stack([right, np.cross(forward, right), forward], axis=1)


@settings(max_examples=40)
@given(seeds)
def test_a_similarity_is_found(seed: int) -> None:
    generator = np.random.default_rng(seed)
    points, weights = generator.normal(size=(8, 3)), generator.uniform(0.5, 1, 8)
    true = Similarity(generator.uniform(0.1, 10), random_rotation(generator), generator.normal(size=3))
    found = similarity(points, true.apply(points), weights)
    np.testing.assert_allclose(found.apply(points), true.apply(points), atol=1e-9)


@settings(max_examples=40)
@given(seeds, st.integers(0, 4))
def test_gps_gives_metres_and_survives_wrong_places(seed: int, wrong: int) -> None:
    generator = np.random.default_rng(seed)
    metres = generator.uniform(-60, 60, size=(20, 3)) * [1, 0.2, 1]
    turn = random_rotation(generator)
    centres = (metres - 5) @ turn.T / 17
    places = metres + generator.normal(scale=0.5, size=metres.shape)
    places[:wrong] += [300, 0, -200]
    places[-1] = np.nan
    found = from_places(centres, places)
    assert found is not None
    assert found.scale == pytest.approx(17, rel=0.1)
    assert np.linalg.norm(found.apply(centres)[wrong:] - metres[wrong:], axis=1).max() < 6


@pytest.mark.parametrize(
    ("spread", "count"),
    [([2, 2, 2], 20), ([80, 0.1, 0.1], 20), ([60, 60, 60], 4)],
    ids=["walk around a table", "straight line", "few"],
)
def test_gps_that_tells_too_little_is_not_used(spread: list[float], count: int) -> None:
    generator = np.random.default_rng(0)
    metres = generator.uniform(-1, 1, size=(count, 3)) * spread
    assert from_places(metres / 3, metres + generator.normal(scale=1.5, size=metres.shape)) is None


@settings(max_examples=40)
@given(seeds, st.sampled_from(["around", "one way"]))
def test_up_is_found_however_cameras_are_held(seed: int, way: str) -> None:
    generator = np.random.default_rng(seed)
    headings = generator.uniform(-np.pi, np.pi, 40) if way == "around" else generator.normal(scale=0.1, size=40)
    rotations = looking(headings, generator.uniform(-0.7, 0.3, 40))
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    rotations[:12] = quarter @ rotations[:12]
    turn = random_rotation(generator)
    assert up_direction(rotations @ turn.T) @ (turn @ [0, -1, 0]) > np.cos(np.radians(3))


@settings(max_examples=40)
@given(seeds)
def test_the_world_stands_upright_around_what_is_seen(seed: int) -> None:
    generator = np.random.default_rng(seed)
    headings = generator.uniform(-np.pi, np.pi, 30)
    rotations = looking(headings, np.full(30, -0.5))
    centres = -4.0 * rotations[:, 2] + [1, 2, 3]
    points = generator.normal([1, 2, 3], 0.3, size=(200, 3))
    turn, scale = random_rotation(generator), generator.uniform(1e-3, 1e3)
    found = upright(rotations @ turn.T, scale * centres @ turn.T, scale * points @ turn.T)
    after = rotations @ turn.T @ found.rotation.T
    assert np.allclose(after[:, 0, 1], 0, atol=1e-3)  # the cameras' horizontal axes are horizontal
    assert np.all(after[:, 1, 1] > 0.5)  # and their downward ones point down
    assert np.linalg.det(found.rotation) == pytest.approx(1)
    distances = np.linalg.norm(found.apply(scale * centres @ turn.T), axis=1)
    assert np.median(distances) == pytest.approx(MEDIAN_DISTANCE, rel=0.1)


def test_places_in_local_metres() -> None:
    """A second of latitude is 30.9 m, and one of longitude 15.4 m at 60 degrees north."""
    step = 1 / 3600
    places = [(60.0, 25.0, 10.0), (60.0 + step, 25.0, 10.0), None, (60.0, 25.0 + step, 30.0)]
    metres = local_metres(places)
    assert metres is not None
    assert np.isnan(metres[2]).all()
    np.testing.assert_allclose(metres[1] - metres[0], [0, 0, 30.95], atol=0.02)
    np.testing.assert_allclose(metres[3] - metres[0], [15.5, -20, 0], atol=0.05)
    assert local_metres([places[0], None, places[1]]) is None


def test_places_on_both_sides_of_the_180th_meridian() -> None:
    """They are as far apart as others of these latitudes and differences of longitude."""
    west = [(-16.8, 139.9999, 10.0), (-16.8001, 140.0001, 12.0), (-16.8, 140.0003, 10.0), (-16.8, 139.9998, 10.0)]
    across = [(latitude, (longitude + 40 + 180) % 360 - 180, altitude) for latitude, longitude, altitude in west]
    assert min(longitude for _, longitude, _ in across) < 0
    for places in (across, across[1:]):
        found, expected = local_metres(places), local_metres(west[len(west) - len(places) :])
        assert found is not None
        assert expected is not None
        np.testing.assert_allclose(found, expected, atol=1e-3)


@pytest.mark.parametrize(("wrong", "used"), [(8, True), (9, False)])
def test_gps_is_used_only_if_most_places_agree(wrong: int, used: bool) -> None:
    """Places that only just most others agree with may be chance."""
    generator = np.random.default_rng(0)
    metres = generator.uniform(-60, 60, size=(20, 3)) * [1, 0.2, 1]
    places = metres + generator.normal(scale=0.5, size=metres.shape)
    places[:wrong] += generator.uniform(-300, 300, (wrong, 3))
    assert (from_places(metres / 17, places) is not None) == used
