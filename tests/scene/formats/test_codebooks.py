"""Codebooks of numbers: how near their entries are to ordinary and to odd values."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from pocketgs.scene.formats.codebooks import scalar_codebook

BULK = np.random.default_rng(0).normal(-5.0, 1.0, 30_000)


def errors_of(values: np.ndarray) -> np.ndarray:
    book, rows = scalar_codebook(values, 256)
    return np.abs(book[rows] - values)


@pytest.mark.parametrize(
    "others",
    [[300.0], [-87.3] * 10_000, np.geomspace(10.0, 1e5, 30), [-1e30, 1e30], np.linspace(3.0, 6.0, 12)],
    ids=["one", "a third at one place", "many", "on both sides", "a far background"],
)
def test_outliers_leave_the_others_their_entries(others: np.ndarray | list[float]) -> None:
    values = np.concatenate([BULK, others])
    errors = errors_of(values)
    assert errors.max() < 0.05
    assert np.sqrt(np.mean(errors[: len(BULK)] ** 2)) < 1.3 * np.sqrt(np.mean(errors_of(BULK) ** 2))


@given(arrays.arrays(np.float32, st.integers(257, 600), elements=st.floats(width=32, allow_nan=False)))
def test_any_numbers(values: np.ndarray) -> None:
    """Entries ascend, and each value gets its nearest one."""
    values = np.where(np.isfinite(values), values, 0.0)
    book, rows = scalar_codebook(values, 256)
    assert book.shape == (256,)
    assert np.isfinite(book).all()
    assert (np.diff(book) >= 0).all()
    errors = np.abs(book[rows] - values.astype(np.float64))
    nearest = np.abs(book - values.astype(np.float64)[:, None]).min(axis=1)
    np.testing.assert_allclose(errors, nearest, rtol=1e-9)
