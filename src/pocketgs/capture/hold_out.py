"""Which frames are kept for evaluation."""

from __future__ import annotations

from pocketgs.capture.listing import Listing


def choose_held_out(listing: Listing, every: int) -> tuple[frozenset[str], str]:
    """The names of the frames to hold out, and the protocol in words.

    Args:
        listing: the capture; the split it states, if any, is followed.
        every: otherwise hold out frames 0, every, 2·every, … of those sorted by name; 0 holds nothing out, not even
            what the data set's split sets apart.
    """
    if every == 0:
        return frozenset(), "nothing held out"
    if listing.held_out is not None:
        return listing.held_out, "data set's own split"
    names = sorted(frame.name for frame in listing.frames)
    return frozenset(names[::every]), f"held out every {ordinal(every)} by name"


def ordinal(number: int) -> str:
    """The number as a rank: 1st, 2nd, 3rd, 4th, 11th …."""
    suffix = "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{suffix}"
