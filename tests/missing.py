"""What a test needs and this machine may lack."""

from __future__ import annotations

import os
from typing import NoReturn

import pytest


def unavailable(reason: str) -> NoReturn:
    """Leave the test out, but fail where continuous integration must have what is missing."""
    if os.environ.get("CI"):
        pytest.fail(reason)
    pytest.skip(reason)
