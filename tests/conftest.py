"""What all tests share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of real captures, from POCKETGS_DATA or beside the repository; tests without it are skipped."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("POCKETGS_DATA", beside))
    if not folder.is_dir():
        pytest.skip(f"no real captures at {folder}: set POCKETGS_DATA to their folder")
    return folder
