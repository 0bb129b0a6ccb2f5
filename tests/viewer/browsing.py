"""A browser that opens the page, and user actions: dragging, touching, dropping files."""

from __future__ import annotations

import base64
import io
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import Browser, Locator, Page, sync_playwright

from missing import unavailable

BROWSERS = ("chromium", "google-chrome", "chromium-browser")

# A GPU in software that draws on canvases too. Workgroup memory is not initialised: it would write each zero by an
# instruction of its own, and compile for three times as long. No shader of ours needs the zeros. Text and buttons are
# not painted by such a GPU.
FLAGS = (
    "--enable-unsafe-webgpu",
    "--use-webgpu-adapter=swiftshader",
    "--enable-features=Vulkan",
    "--use-vulkan=swiftshader",
    "--use-angle=swiftshader",
    "--enable-dawn-features=disable_workgroup_init",
    "--disable-gpu-rasterization",
    "--no-sandbox",
    "--disable-background-networking",
    "--disable-component-update",
    "--no-first-run",
)
NO_GPU = "delete Navigator.prototype.gpu"
"""A script that takes WebGPU from a page."""
NO_SOCKET = """
window.WebSocket = class extends EventTarget {
    constructor() {
        super();
        setTimeout(() => this.dispatchEvent(new Event("close")));
    }
};
"""
"""A script that lets no WebSocket open, as Safari does on pages with a self-signed certificate."""
PATIENCE = 120_000
"""Milliseconds: compiling shaders for a GPU in software takes its time."""


@contextmanager
def open_browser() -> Iterator[Browser]:
    """Start the browser; skip the test if there is none."""
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        unavailable(f"no browser: found none of {', '.join(BROWSERS)}")
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=program, headless=True, args=FLAGS)
        yield running
        running.close()


@dataclass
class Visit:
    """The page, open.

    Attributes:
        page: what Playwright gives.
        complaints: errors and warnings on the console, and exceptions.
    """

    page: Page
    complaints: list[str] = field(default_factory=list)

    def __getitem__(self, selector: str) -> Locator:
        return self.page.locator(selector)

    def until_drawn(self) -> None:
        """Wait until the picture is there, and sharp."""
        self["#stats:not(:empty)"].wait_for(state="attached", timeout=PATIENCE)
        self["#canvas[aria-busy=false]"].wait_for(timeout=PATIENCE)

    def picture(self) -> np.ndarray:
        """(H, W, 3) float32 in [0, 1]: the image that the save button gives, once nothing moves."""
        self.until_drawn()
        with self.page.expect_download(timeout=PATIENCE) as saved:
            self.page.keyboard.press("p")
        return _decoded(Path(saved.value.path()).read_bytes())

    def seen(self) -> np.ndarray:
        """(H, W, 3) float32 in [0, 1]: a screenshot of the canvas, whichever renderer draws it."""
        self.page.evaluate(
            """() => {
                for (const part of document.querySelectorAll("header, .card")) {
                    part.style.visibility = "hidden";
                }
            }"""
        )
        return _decoded(self.page.screenshot())

    def drag(self, right: float, down: float, button: str = "left") -> None:
        """Drag from the middle of the picture's upper half."""
        size = self.page.viewport_size
        assert size
        x, y = size["width"] / 2, size["height"] / 3
        self.page.mouse.move(x, y)
        self.page.mouse.down(button=button)  # type: ignore[arg-type]
        self.page.mouse.move(x + right, y + down, steps=3)
        self.page.mouse.up(button=button)  # type: ignore[arg-type]

    def touch(self, *ways: tuple[tuple[float, float], tuple[float, float]]) -> None:
        """Put a finger at the begin of each way, and take them all to the ends."""
        session = self.page.context.new_cdp_session(self.page)

        def send(kind: str, share: float) -> None:
            points = [
                {"x": a[0] + share * (b[0] - a[0]), "y": a[1] + share * (b[1] - a[1]), "id": finger}
                for finger, (a, b) in enumerate(ways)
            ]
            session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

        send("touchStart", 0.0)
        for share in (0.25, 0.5, 0.75, 1.0):
            send("touchMove", share)
        session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})

    def drop(self, name: str, content: bytes) -> None:
        """Drop a file on the page, as a file manager does."""
        self.page.evaluate(
            """([name, content]) => {
                const bytes = Uint8Array.from(atob(content), (character) => character.charCodeAt(0));
                const dataTransfer = new DataTransfer();
                dataTransfer.items.add(new File([bytes], name));
                for (const type of ["dragenter", "dragover", "drop"]) {
                    const event = new DragEvent(type, { dataTransfer, bubbles: true, cancelable: true });
                    document.body.dispatchEvent(event);
                }
            }""",
            [name, base64.b64encode(content).decode()],
        )


def _decoded(content: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(content)).convert("RGB"), np.float32) / 255


@contextmanager
def visiting(browser: Browser, url: str, width: int, height: int, script: str | None = None) -> Iterator[Visit]:
    """Open the page in a window of its own.

    Args:
        browser: from `open_browser`.
        url: of the page.
        width: of the window, in pixels.
        height: likewise.
        script: what to run before the page does.
    """
    with browser.new_context(viewport={"width": width, "height": height}, has_touch=True) as context:
        visit = Visit(context.new_page())
        if script:
            visit.page.add_init_script(script)
        visit.page.on("pageerror", lambda error: visit.complaints.append(str(error)))
        visit.page.on(
            "console", lambda message: visit.complaints.append(message.text) if message.type != "log" else None
        )
        visit.page.goto(url)
        yield visit
