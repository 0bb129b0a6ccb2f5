"""What COLMAP's matching is asked and answers, as JSON between two processes."""

from __future__ import annotations

from typing import TypedDict


class MatchingJob(TypedDict):
    """Pairs of images whose features are to be matched.

    Attributes:
        database: file to be made, and removed in the end.
        features: each image's .npz file, by name.
        pairs: of names.
        matches: output file, see `match_file`.
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
