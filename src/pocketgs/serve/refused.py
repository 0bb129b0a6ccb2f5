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


def no_room(found: str) -> RefusedError:
    """The refusal for a full disk."""
    return RefusedError(
        507, f"the computer's disk is full ({found}): delete something there, or empty the trash, and try again"
    )
