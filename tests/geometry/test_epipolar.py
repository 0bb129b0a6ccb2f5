"""Epipolar geometry of known cameras and points."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pocketgs.geometry.epipolar import essential_matrix, sampson_distances
from prior.bundle_problem import make_problem

PROBLEM = make_problem(frames=4, points=100)


def at_depth_1(view: int) -> np.ndarray:
    """(N, 2) where a view sees the points, at depth 1."""
    camera = PROBLEM.true_cameras[view]
    pixels = camera.project(PROBLEM.true_points)[0]
    return (pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy]


def motion(first: int, second: int) -> np.ndarray:
    one, other = PROBLEM.true_cameras[first], PROBLEM.true_cameras[second]
    return other.world_to_camera @ one.camera_to_world


def test_true_matches_are_on_their_lines() -> None:
    for first, second in ((0, 1), (1, 0), (2, 3)):
        distances = sampson_distances(essential_matrix(motion(first, second)), at_depth_1(first), at_depth_1(second))
        np.testing.assert_allclose(distances, 0, atol=1e-12)


@given(st.floats(0, 2 * np.pi), st.floats(1e-5, 1e-3))
def test_no_farther_than_a_match_was_moved(angle: float, distance: float) -> None:
    """To first order, the distance is the smallest movement of both points that makes them match."""
    moved = at_depth_1(1) + distance * np.array([np.cos(angle), np.sin(angle)])
    found = sampson_distances(essential_matrix(motion(0, 1)), at_depth_1(0), moved)
    assert (found <= 1.01 * distance).all()


def test_a_match_moved_across_its_line() -> None:
    """The distance is between half the movement, shared by both points, and all of it."""
    here, there = at_depth_1(0), at_depth_1(1)
    essential = essential_matrix(motion(0, 1))
    lines = np.column_stack([here, np.ones(len(here))]) @ essential.T
    across = lines[:, :2] / np.linalg.norm(lines[:, :2], axis=1, keepdims=True)
    found = sampson_distances(essential, here, there + 1e-4 * across)
    assert (found >= 0.4e-4).all()
    assert (found <= 1.01e-4).all()
