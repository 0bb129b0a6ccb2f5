"""The split into training and held-out frames."""

from __future__ import annotations

from pocketgs.capture.listing import Listing

HOLD_OUT_EVERY = 8
"""Every eighth frame by name is held out by default."""

FEWEST_TO_HOLD_OUT = 4
"""Of fewer frames none is held out, unless every second or third is asked for: they are too few to train on already."""

NOTHING = "nothing held out"


def choose_held_out(listing: Listing, every: int) -> tuple[frozenset[str], str]:
    """Choose the frames to hold out. Returns their names, and the protocol as text.

    Args:
        listing: the capture; its own split is used if it has one.
        every: otherwise hold out frames 0, every, 2·every, … in order of name, unless there are fewer than this
            and than four; 0 holds nothing out, and ignores the data set's split too.
    """
    if every == 0:
        return frozenset(), NOTHING
    if listing.held_out is not None:
        return listing.held_out, "data set's own split"
    names = sorted(frame.name for frame in listing.frames)
    if len(names) < min(FEWEST_TO_HOLD_OUT, every):
        return frozenset(), NOTHING
    return frozenset(names[::every]), f"held out every {ordinal(every)} by name"


def ordinal(number: int) -> str:
    """A number as an ordinal: 1st, 2nd, 3rd, 4th, 11th …."""
    suffix = "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{suffix}"
