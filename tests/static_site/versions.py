"""Other versions of the site."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from pocketgs.site import files


@contextmanager
def another_page(place: Path) -> Iterator[Path]:
    """Let the site be made from a copy of the page's files, which may be changed.

    Args:
        place: an existing folder for the copy.

    Yields:
        The copy.
    """
    copy = place / "another page"
    shutil.copytree(files.PAGE, copy)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(files, "PAGE", copy)
        yield copy
