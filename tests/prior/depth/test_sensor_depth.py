"""Measured depth: taken where matching is unsure, at matching's scale, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from pocketgs.capture.capture import Frame
from pocketgs.geometry.camera import Camera
from pocketgs.prior.depth.sensor_depth import completed
from pocketgs.prior.depth.sweep import DepthMap

SHAPE = 20, 30
STEP = 0.01
UNSURE, UNKNOWN, UNMEASURED = (slice(0, 4), slice(None)), (slice(4, 6), slice(None)), (slice(5, 9), slice(0, 10))


@pytest.fixture
def truth() -> np.ndarray:
    return np.random.default_rng(0).uniform(1, 3, SHAPE).astype(np.float32)


@pytest.fixture
def matched(truth: np.ndarray) -> DepthMap:
    """Right and sure, but for some rows that are wrong and unsure, and some without depth."""
    depth, margin = truth.copy(), np.full(SHAPE, 0.5, np.float32)
    depth[UNSURE], margin[UNSURE] = 9, 0.001
    depth[UNKNOWN], margin[UNKNOWN] = 0, 0
    return DepthMap(depth, margin, STEP)


def frame(depth: np.ndarray | None, mask: np.ndarray | None = None) -> Frame:
    camera = Camera(SHAPE[1], SHAPE[0], 30.0, 30.0, 15.0, 10.0, np.eye(4))
    return Frame("0.png", camera, np.zeros((*SHAPE, 3), np.uint8), mask=mask, depth=depth)


def test_what_a_mask_leaves_out_has_no_depth(truth: np.ndarray, matched: DepthMap) -> None:
    mask = np.ones(SHAPE, bool)
    mask[UNKNOWN] = False
    assert not completed(matched, frame(truth, mask)).depth[UNKNOWN].any()


def test_without_a_sensor_nothing_changes(matched: DepthMap) -> None:
    assert completed(matched, frame(None)) is matched
    found = completed(matched, frame(np.zeros(SHAPE, np.float32)))
    np.testing.assert_array_equal(found.depth, matched.depth)
    np.testing.assert_array_equal(found.margin, matched.margin)


@pytest.mark.parametrize("scale", [1.0, 0.97, 1.2])
def test_measured_depth_where_matching_is_unsure(truth: np.ndarray, matched: DepthMap, scale: float) -> None:
    """However long the sensor's metre is."""
    measured = (truth / scale).astype(np.float32)
    measured[UNMEASURED] = 0
    found = completed(matched, frame(measured))
    assert found.depth.dtype == found.margin.dtype == np.float32
    expected = truth.copy()
    expected[UNMEASURED] = matched.depth[UNMEASURED]
    np.testing.assert_allclose(found.depth, expected, rtol=1e-5)
    believed = (found.depth > 0) & (matched.margin < 0.01)
    assert np.all(found.margin[believed] > 0.01)
    np.testing.assert_array_equal(found.margin[~believed], matched.margin[~believed])
    assert found.step == STEP


def test_some_wrong_measurements_do_not_change_the_scale(truth: np.ndarray, matched: DepthMap) -> None:
    measured = truth.copy()
    measured[15:] *= 3
    found = completed(matched, frame(measured))
    np.testing.assert_allclose(found.depth[UNSURE], truth[UNSURE], rtol=1e-5)


def test_where_matching_is_sure_of_nothing_measured_depths_stay(truth: np.ndarray) -> None:
    nothing = DepthMap(*np.zeros((2, *SHAPE), np.float32), STEP)
    np.testing.assert_array_equal(completed(nothing, frame(truth)).depth, truth)
