"""The CPU engine leaves out a random share of the Gaussians."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from pocketgs import PocketGSError
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.settings import Dropout
from splat.dropout import assert_a_rendering_shows_all, assert_a_step_leaves_out_a_share

MakeGaussians = Callable[..., Gaussians]


@pytest.mark.parametrize("threads", [1, 2])
def test_a_step_leaves_out_a_share(make_gaussians: MakeGaussians, threads: int) -> None:
    assert_a_step_leaves_out_a_share(CpuEngine(threads), make_gaussians)


def test_a_rendering_shows_all(make_gaussians: MakeGaussians) -> None:
    assert_a_rendering_shows_all(CpuEngine(1), make_gaussians)


@pytest.mark.parametrize("share", [-0.1, 1.0, float("nan")])
def test_shares_out_of_range(share: float) -> None:
    with pytest.raises(PocketGSError, match="dropout: found a share of"):
        Dropout(share, 0)
