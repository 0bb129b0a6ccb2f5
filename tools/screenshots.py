"""Make the images of the viewer in `docs/images`: following a run, its result, and the page on a phone.

It needs PocketGS with its `dev` extra, and Chromium or Chrome, but no GPU: the browser runs without one.

    python tools/screenshots.py                                        # trains on the built-in demo
    python tools/screenshots.py --result RESULT --capture CAPTURE      # shows a result; nothing is trained
"""

from __future__ import annotations

import argparse
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import Browser, Page, ViewportSize, sync_playwright

IMAGES = Path(__file__).parents[1] / "docs" / "images"
BROWSERS = ("chromium", "google-chrome", "chromium-browser")
SOFTWARE_GPU = (
    "--enable-unsafe-webgpu",
    "--use-webgpu-adapter=swiftshader",
    "--enable-features=Vulkan",
    "--use-vulkan=swiftshader",
    "--use-angle=swiftshader",
    "--no-sandbox",
)
DESKTOP: ViewportSize = {"width": 1000, "height": 640}
PHONE: ViewportSize = {"width": 360, "height": 740}
SHARE_OF_RUN = 0.4
"""Progress of the run at which its image is taken."""

QUALITY = 85
PATIENCE = 600_000
"""Milliseconds: software rendering is slow, and so is training at the same time."""


def main() -> None:
    """Take the pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--result", type=Path, help="result folder or scene file to show, rather than the demo's")
    parser.add_argument("--capture", help="the result's capture, for its cameras and photographs")
    parser.add_argument("--images", help="the capture's folder of images, as for pocketgs view")
    parser.add_argument("--output", type=Path, default=IMAGES, help="folder for the pictures")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    capture = ["--capture", arguments.capture] if arguments.capture else []
    capture += ["--images", arguments.images] if arguments.images else []
    with tempfile.TemporaryDirectory() as folder, _browser() as browser:
        result = arguments.result
        if result is None:
            result, capture = Path(folder, "demo"), ["--capture", str(Path(folder, "demo-capture"))]
            _picture_of_run(browser, result, Path(capture[1]), arguments.output)
        with _serving("view", str(result), *capture) as url:
            _pictures_of_result(browser, url, arguments.output)


@contextmanager
def _browser() -> Iterator[Browser]:
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        sys.exit(f"no browser: found none of {', '.join(BROWSERS)}")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=SOFTWARE_GPU)
        yield browser
        browser.close()


@contextmanager
def _serving(*command: str) -> Iterator[str]:
    """Run a `pocketgs` command that serves a page, and stop it as Ctrl-C does; yields the page's address."""
    program = [sys.executable, "-m", "pocketgs", *command, "--no-open"]
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        printed = process.stdout.readline()
        address = re.search(r"http://\S+", printed)
        if not address:
            sys.exit(f"{' '.join(program)}: printed no address: {printed}{process.stdout.read()}")
        try:
            yield address[0]
        finally:
            process.send_signal(signal.SIGINT)
            process.stdout.read()


def _picture_of_run(browser: Browser, result: Path, capture: Path, output: Path) -> None:
    with _serving("demo", "--output", str(result), "--capture", str(capture), "--view") as url:
        page = browser.new_page(viewport=DESKTOP)
        page.goto(url)
        _wait_for_picture(page)
        _wait_for_share(page, SHARE_OF_RUN)
        page.screenshot(path=output / "viewer-live.jpg", quality=QUALITY)
        _wait_for_share(page, 1.0)
        page.locator("#stage", has_text="finished").wait_for(timeout=PATIENCE)
        page.close()


def _pictures_of_result(browser: Browser, url: str, output: Path) -> None:
    page = browser.new_page(viewport=DESKTOP)
    page.goto(url)
    _wait_until_drawn(page)
    page.screenshot(path=output / "viewer-desktop.jpg", quality=QUALITY)
    if page.locator("#compare-button").is_enabled():
        page.click("#compare-button")
        page.locator("#photo-tag").wait_for(timeout=PATIENCE)
        page.locator("#photo").evaluate("photo => photo.decode()")
        _wait_until_drawn(page)
        page.screenshot(path=output / "viewer-compare.jpg", quality=QUALITY)
    page.close()
    page = browser.new_page(viewport=PHONE, has_touch=True, is_mobile=True)
    page.goto(url)
    _wait_until_drawn(page)
    page.screenshot(path=output / "viewer-phone.jpg", quality=QUALITY)
    page.close()


def _wait_for_share(page: Page, share: float) -> None:
    """Wait until this share of the run's iterations is done."""
    while float(page.locator("#training").evaluate("bar => bar.value")) < share:
        page.wait_for_timeout(250)


def _wait_for_picture(page: Page) -> None:
    page.locator("#stats:not(:empty)").wait_for(state="attached", timeout=PATIENCE)


def _wait_until_drawn(page: Page) -> None:
    """Wait until nothing changes any more: during a run, scenes arrive faster than they can be drawn here."""
    _wait_for_picture(page)
    page.locator("#canvas[aria-busy=false]").wait_for(timeout=PATIENCE)


if __name__ == "__main__":
    main()
