"""The site, written once and served, and a page to call its modules on."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page

from capture.conftest import colmap_files, copied_phone, ring, written_phones  # noqa: F401 - fixtures
from pocketgs.site.write import write_site
from static_site.hosting import Host, hosting
from viewer.browsing import open_browser


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("host") / "site"
    write_site(folder)
    return folder


@pytest.fixture(scope="session")
def version(site: Path) -> Path:
    """The folder of everything but the page itself."""
    [version] = (path.parent for path in site.glob("*/train"))
    return version


@pytest.fixture(scope="module")
def host(site: Path) -> Iterator[Host]:
    with hosting(site) as host:
        yield host


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with open_browser() as running:
        yield running


@pytest.fixture(scope="module")
def modules(browser: Browser, host: Host, version: Path) -> Iterator[Page]:
    """A page of the same origin that starts nothing by itself."""
    page = browser.new_page()
    page.goto(f"{host.address}{version.name}/train/settings.json")
    yield page
    page.close()


@pytest.fixture(scope="module")
def call(modules: Page) -> Callable[..., Any]:
    """A function that calls what a module of the page exports: `call("random/generator.js", script, argument)`.

    The script is the body of a function of `module`, `settings` and `given`. Values travel as one text, since
    Playwright takes seconds per megabyte of numbers; NaN and Infinity come back as those words.
    """

    def run(module: str, script: str, given: Any = None) -> Any:
        found = modules.evaluate(
            f"""async ([text, path]) => {{
                const given = JSON.parse(text);
                const module = await import(new URL(path, location.href));
                const settings = await (await fetch(location.href)).json();
                const run = async () => {{
                    {script}
                }};
                const isWord = (value) => typeof value === "number" && !Number.isFinite(value);
                return JSON.stringify(await run(), (_, value) => (isWord(value) ? `${{value}}` : value));
            }}""",
            [json.dumps(given, allow_nan=False), module],
        )
        return found and json.loads(found)

    return run
