"""Merging: what a voxel's pixels become does not depend on where walls lie."""

from __future__ import annotations

import numpy as np

from pocketgs.prior.cloud.cpu.merger import CpuMerger
from pocketgs.prior.cloud.merge import TURN, Candidates, turned


def wall(offset: float, noise: float, count: int = 40_000) -> Candidates:
    """Pixels of a wall of 1 x 1 that is parallel to two of the world's axes, a little before and behind it."""
    rng = np.random.default_rng(0)
    positions = np.column_stack([rng.uniform(0, 1, (count, 2)), rng.normal(offset, noise, count)])
    ones = np.ones(count)
    return Candidates(positions, np.ones((count, 3)), np.tile([0.0, 0.0, 1.0], (count, 1)), 0.02 * ones, ones, ones)


def test_a_wall_is_one_sheet_of_points_wherever_it_is() -> None:
    """A voxel's side along the wall would divide its pixels between two voxels, one before and one behind it."""
    noise, side = 0.002, 0.02
    errors = []
    for offset in np.linspace(0.0, side, 9):
        points = CpuMerger().merged(wall(offset, noise), 2500).positions
        errors.append(np.sqrt(np.mean((points[:, 2] - offset) ** 2)))
    assert max(errors) < 1.2 * min(errors)
    assert max(errors) < 0.75 * noise


def test_pixels_of_different_footprints_are_not_merged() -> None:
    """Twice as far from the origin and twice as large: in the same cell, of voxels that are twice as large."""
    rng = np.random.default_rng(2)
    near, ones = rng.uniform(0.5, 1.0, (100, 3)), np.ones(200)
    positions, footprints = np.concatenate([near, 2.0 * near]), np.repeat([0.01, 0.02], 100)
    directions = np.tile([0.0, 0.0, 1.0], (200, 1))
    found = CpuMerger().merged(Candidates(positions, np.ones((200, 3)), directions, footprints, ones, ones), 200)
    np.testing.assert_allclose(found.positions[found.positions[:, 0].argsort()], positions[positions[:, 0].argsort()])


def test_a_voxel_is_the_mean_of_its_pixels_weighed_by_their_confidences() -> None:
    """Three pixels near to one another, and one apart; the confidence itself is an unweighted mean."""
    confidences = np.array([0.2, 0.4, 0.9, 0.7])
    positions = np.array([[0.5, 0.5, 0.500], [0.5, 0.5, 0.501], [0.5, 0.5, 0.503], [9.0, 0.5, 0.5]])
    colours, ones = np.random.default_rng(3).uniform(size=(4, 3)), np.ones(4)
    directions = np.tile([0.0, 0.0, 1.0], (4, 1))
    found = CpuMerger().merged(Candidates(positions, colours, directions, 0.1 * ones, ones, confidences), 2)
    order = found.positions[:, 0].argsort()
    weights = np.array([[0.2, 0.4, 0.9, 0.0], [0.0, 0.0, 0.0, 0.7]]) / [[1.5], [0.7]]
    np.testing.assert_allclose(found.confidences[order], [0.5, 0.7], rtol=1e-6)
    np.testing.assert_allclose(found.positions[order], weights @ positions, rtol=1e-6)
    np.testing.assert_allclose(found.colours[order], weights @ colours, rtol=1e-6)


def test_the_grid_is_turned_and_not_stretched() -> None:
    """By a rotation that keeps every side of a voxel 18 degrees and more away from walls along the axes."""
    np.testing.assert_allclose(TURN @ TURN.T, np.eye(3), atol=1e-15)
    positions = np.random.default_rng(1).normal(size=(100, 3))
    np.testing.assert_allclose(turned(positions), positions @ TURN.T, rtol=1e-12, atol=1e-12)
    assert np.abs(TURN).max() < 0.95
