"""What a request is refused with."""

from __future__ import annotations

import errno

FULL = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC), errno.EFBIG)
"""Errors of a disk that is full, or that the user may not fill further."""


class RefusedError(Exception):
    """A request that is refused.

    Args:
        status: of the HTTP response.
        sentence: for the user.
        facts: further fields of the response's JSON.
    """

    def __init__(self, status: int, sentence: str, **facts: int) -> None:
        super().__init__(sentence)
        self.status, self.sentence, self.facts = status, sentence, facts


def is_full(error: Exception) -> bool:
    """Whether a full disk is the reason for an error, or for the one that it was raised from."""
    reason = error if isinstance(error, OSError) else error.__cause__
    return isinstance(reason, OSError) and reason.errno in FULL


def no_room(found: str, then: str = "try again") -> RefusedError:
    """The refusal for a full disk.

    Args:
        found: how things are.
        then: what to do when there is room.
    """
    return RefusedError(
        507, f"the computer's disk is full ({found}): delete something there, or empty the trash, and {then}"
    )
