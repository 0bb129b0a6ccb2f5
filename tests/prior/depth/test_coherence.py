"""Depths that most of those around them do not share need more than one view to confirm them."""

from __future__ import annotations

import numpy as np
import pytest

from pocketgs.prior.depth.confidence import FILLER_CONFIDENCE
from pocketgs.prior.depth.consistency import AROUND, COHERENT_STEPS, SweptViews
from pocketgs.prior.depth.cpu.consistency import compare_depths
from pocketgs.prior.depth.cpu.stereo import CpuStereo

STEP, LEAST = 0.01, 0.4
HEIGHT, WIDTH = 40, 60


def stacked(depth: np.ndarray, views: int, step: float = STEP) -> SweptViews:
    """Up to three views with the same depths, from places so close together that pixels of one fall on the others'."""
    places = 0.02 * float(np.median(depth[depth > 0])) * np.array([0, 1, -1])[:views]
    return SweptViews(
        np.repeat(depth[None].astype(np.float32), views, axis=0),
        np.tile([20.0, 20.0, WIDTH / 2, HEIGHT / 2], (views, 1)),
        np.tile([HEIGHT, WIDTH], (views, 1)),
        np.tile(np.eye(3), (views, 1, 1)),
        np.stack([places, 0 * places, 0 * places], axis=1),
        np.full(views, step),
    )


def confidences(views: SweptViews) -> np.ndarray:
    """Of the first view's depths, all of which have a clear margin."""
    margins = [np.ones((HEIGHT, WIDTH), np.float32)] * len(views.depths)
    return next(CpuStereo().compare(views, margins, 1e-6, LEAST)).confidences


def noise() -> np.ndarray:
    return 1 / np.random.default_rng(0).uniform(0.1, 1.0, (HEIGHT, WIDTH))


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_a_slanted_surface_is_coherent_and_noise_is_not(scale: float) -> None:
    """In any unit; on the left the surface, on the right noise."""
    inverse = np.tile(0.3 + 0.25 * COHERENT_STEPS * STEP * np.arange(WIDTH), (HEIGHT, 1))
    inverse[:, WIDTH // 2 :] = 1 / noise()[:, WIDTH // 2 :]
    _, contradicting, _ = compare_depths(stacked(scale / inverse, 1, STEP / scale), 0, 0.01)
    assert not contradicting[:, : WIDTH // 2 - AROUND].any()
    assert np.mean(contradicting[:, WIDTH // 2 + AROUND :]) > 0.99


def test_unknown_depths_take_no_part() -> None:
    """Four in five are unknown; the others are the same."""
    depth = np.where(np.random.default_rng(0).random((HEIGHT, WIDTH)) < 0.2, 5.0, 0.0)
    assert not compare_depths(stacked(depth, 1), 0, 0.01)[1].any()


def test_noise_does_not_fill_holes() -> None:
    depth = np.full((HEIGHT, WIDTH), 5.0)
    depth[:, WIDTH // 2 :] = noise()[:, WIDTH // 2 :]
    found = confidences(stacked(depth, 1))
    assert np.all(found[:, : WIDTH // 2 - AROUND] == np.float32(FILLER_CONFIDENCE))
    assert np.mean(found[:, WIDTH // 2 + AROUND :] > 0) < 0.01


def test_a_thread_needs_two_views_to_confirm_it() -> None:
    """One pixel wide, before a wall; one view confirms the wall."""
    depth = np.full((HEIGHT, WIDTH), 5.0)
    depth[:, WIDTH // 2] = 4.98
    for others, believed in ((1, False), (2, True)):
        found = confidences(stacked(depth, 1 + others, 1e-4))
        assert np.all((found[:, WIDTH // 2] >= LEAST) == believed)
        assert np.all(found[:, : WIDTH // 2 - AROUND] >= LEAST)
