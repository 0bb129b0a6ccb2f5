"""Warnings about scenes, as Python warnings of one category."""

from __future__ import annotations

import warnings


class SceneWarning(UserWarning):
    """A scene was read or written, but it may look worse than its author saw it."""


def warn(message: str) -> None:
    """Warn; Python shows the same message once, unless told otherwise."""
    warnings.warn(message, SceneWarning, stacklevel=2)
