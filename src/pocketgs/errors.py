"""The one exception type that bad input raises."""

from __future__ import annotations

import re


class PocketGSError(Exception):
    """Something the user can put right: the message names it, what was found and what was expected.

    The command line prints the message as one line and exits with status 2.

    Args:
        message: where it is far longer than a line, what is longest in it is cut, as files and other programs may say
            part of it.
    """

    def __init__(self, message: object = "") -> None:
        said = str(message)
        if len(said) > MAX_MESSAGE:
            said = re.sub(r"\S{200,}", lambda word: f"{word[0][:100]}...{word[0][-40:]}", said)[:MAX_MESSAGE]
        super().__init__(said)


MAX_SHOWN, MAX_MESSAGE = 80, 1000


def short(found: object) -> str:
    """What was found, as a message may quote it: in Python's notation, cut where it is long."""
    if isinstance(found, float):
        return f"{found:g}"
    try:
        shown = repr(found)
    except ValueError:  # Python writes out no whole number of thousands of digits
        shown = f"{type(found).__name__} of thousands of digits"
    return clipped(shown)


def clipped(text: object) -> str:
    """A text, of which files or other programs say what it is, no longer than a message should quote it."""
    shown = str(text)
    return shown if len(shown) <= MAX_SHOWN else f"{shown[: MAX_SHOWN - 3]}..."
