"""The search for the smallest file within a bound."""

from __future__ import annotations

import pytest

from pocketgs.compression.bound import QualityBound, SizeBound
from pocketgs.compression.candidates import Candidate
from pocketgs.errors import PocketGSError

SMALL, MIDDLE, LARGE = (Candidate(1, bytes(size), psnr) for size, psnr in ((1000, 20.0), (2000, 25.0), (3000, 30.0)))
ALL = [MIDDLE, LARGE, SMALL]


@pytest.mark.parametrize(("psnr", "best"), [(19.0, SMALL), (20.0, SMALL), (20.1, MIDDLE), (26.0, LARGE), (31.0, LARGE)])
def test_the_smallest_file_of_sufficient_quality(psnr: float, best: Candidate) -> None:
    """Or, if none suffices, the best one."""
    assert QualityBound(psnr).best(ALL) is best


@pytest.mark.parametrize(("megabytes", "best"), [(0.001, SMALL), (0.0029, MIDDLE), (1.0, LARGE)])
def test_the_best_file_that_is_small_enough(megabytes: float, best: Candidate) -> None:
    assert SizeBound(megabytes).best(ALL) is best


def test_no_file_is_small_enough() -> None:
    expected = r"the smallest file has 0\.001000 MB, expected --size of at least some 0\.0011$"
    with pytest.raises(PocketGSError, match=expected):
        SizeBound(0.0009).best(ALL)
