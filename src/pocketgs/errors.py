"""The one exception type that bad input raises, and the wording of messages."""

from __future__ import annotations

import re
from collections.abc import Sequence

USER_ERROR = 2
"""Exit status of a command that ended with such an error."""


class PocketGSError(Exception):
    """An error that the user can fix. The message names the file, what was found and what was expected.

    The command line prints the message as one line and exits with status `USER_ERROR`.

    Args:
        message: cut in its longest part where it is far longer than a line, since it may quote files or other programs.
    """

    def __init__(self, message: object = "") -> None:
        said = str(message)
        if len(said) > MAX_MESSAGE:
            said = re.sub(r"\S{200,}", lambda word: f"{word[0][:100]}...{word[0][-40:]}", said)[:MAX_MESSAGE]
        super().__init__(said)


MAX_SHOWN, MAX_MESSAGE = 80, 1000


def short(found: object) -> str:
    """`repr` of a value for a message, cut where it is long."""
    if isinstance(found, float):
        return f"{found:g}"
    try:
        shown = repr(found)
    except ValueError:  # Python refuses to print integers of thousands of digits
        shown = f"{type(found).__name__} of thousands of digits"
    return clipped(shown)


def counted(number: int, one: str, several: str) -> str:
    """A number with the words that follow 1, or any other number: "1 frame sees", "2 frames see"."""
    return f"{number} {one if number == 1 else several}"


def listed(names: Sequence[str], most: int) -> str:
    """Names for a message, and how many more there are than `most`: "a, b and 3 more"."""
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")


def clipped(text: object) -> str:
    """Untrusted text, cut to the length that a message may quote."""
    shown = str(text)
    return shown if len(shown) <= MAX_SHOWN else f"{shown[: MAX_SHOWN - 3]}..."
