"""Detail: 0 on plain surfaces, the contrast of fine structures, and little for coarse ones."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pocketgs.prior.cloud.detail import detail


def stripes(period: int, low: int = 0, high: int = 200) -> np.ndarray:
    """(48, 64, 3) vertical stripes."""
    values = np.where(np.arange(64) % period < period / 2, low, high).astype(np.uint8)
    return np.broadcast_to(values[None, :, None], (48, 64, 3)).copy()


@given(st.integers(0, 255))
def test_a_plain_surface_has_none(value: int) -> None:
    found = detail(np.full((20, 30, 3), value, np.uint8))
    assert (found.shape, found.dtype) == ((20, 30), np.float32)
    assert found.max() < 1e-5


def test_the_finest_stripes_have_their_contrast() -> None:
    # Blurring leaves nothing of them but their mean: what it takes away is half their height at every pixel.
    found = detail(stripes(2))[10:-10, 10:-10]
    np.testing.assert_allclose(found, 100 / 255, rtol=0.02)


def test_it_grows_with_contrast_and_falls_with_size() -> None:
    means = [float(detail(stripes(period)).mean()) for period in (2, 4, 8, 16, 32)]
    assert means == sorted(means, reverse=True)
    assert means[-1] < 0.3 * means[0]
    np.testing.assert_allclose(detail(stripes(8, 0, 100)), detail(stripes(8, 0, 200)) / 2, atol=1e-5)


def test_it_is_where_the_edge_is() -> None:
    image = np.zeros((40, 40, 3), np.uint8)
    image[:, 20:] = 255
    found = detail(image)
    assert found[:, 19:21].min() > 0.1
    assert max(found[:, :12].max(), found[:, 28:].max()) < 1e-3
