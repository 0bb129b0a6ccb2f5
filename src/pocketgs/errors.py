"""The one exception type that bad input raises."""

from __future__ import annotations


class PocketGSError(Exception):
    """Something the user can put right: the message names it, what was found and what was expected.

    The command line prints the message as one line and exits with status 2.
    """
