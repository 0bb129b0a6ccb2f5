"""Files with the matches of pairs of images, .npz.

`first` and `second` are the (P,) names of the pairs that match, `counts` the (P,) numbers of their matches, and
`matches` the (M, 2) uint32 features of both images, of one pair after the other.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

Matches = Mapping[tuple[str, str], np.ndarray]
"""(M, 2) uint32 features of both images, by pair of names."""


def write_match_file(path: str | Path, matches: Matches) -> None:
    """Write the matches of pairs."""
    np.savez(
        path,
        first=np.array([first for first, _ in matches], dtype=str),
        second=np.array([second for _, second in matches], dtype=str),
        counts=np.array([len(rows) for rows in matches.values()], np.int64),
        matches=np.concatenate([np.zeros((0, 2), np.uint32), *matches.values()]),
    )


def read_match_file(path: str | Path) -> Matches:
    """The matches of pairs."""
    with np.load(path) as found:
        pairs = zip(found["first"].tolist(), found["second"].tolist(), strict=True)
        # Without pairs, there is still one part, which is empty.
        parts = np.split(found["matches"], np.cumsum(found["counts"])[:-1])
    return dict(zip(pairs, parts, strict=False))
