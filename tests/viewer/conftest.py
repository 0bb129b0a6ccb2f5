"""Shared fixtures of the page's tests."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page

from pocketgs.viewer.content import Content
from pocketgs.viewer.server import serving
from viewer.browsing import NO_GPU, open_browser, visiting


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """A browser for the tests of one file."""
    with open_browser() as running:
        yield running


@pytest.fixture(scope="module")
def page(browser: Browser) -> Iterator[Page]:
    """A page that shows nothing and has no GPU, to call its modules on."""
    with serving(Content("nothing")) as served, visiting(browser, served.url, 400, 300, script=NO_GPU) as visit:
        yield visit.page
