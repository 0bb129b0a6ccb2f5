"""What COLMAP's matching is asked and answers, as JSON between two processes."""

from __future__ import annotations

from typing import TypedDict


class MatchingJob(TypedDict):
    """Pairs of images whose features are to be matched.

    Attributes:
        database: file to be made, and removed in the end.
        features: each image's .npz file, by name.
        pairs: of names.
        matches: output .npz file: `first` and `second`, (P,) names of the pairs that match; `counts`, (P,) numbers of
            their matches; `matches`, (M, 2) uint32 features of both images, of one pair after the other.
    """

    database: str
    features: dict[str, str]
    pairs: list[tuple[str, str]]
    matches: str


class MatchingOutcome(TypedDict):
    """The result.

    Attributes:
        matched_pairs: number of pairs with matches.
    """

    matched_pairs: int
