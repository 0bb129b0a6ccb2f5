"""The page that shows a scene or follows a run: its options, its address, and its end."""

from __future__ import annotations

import os
import sys
import time
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pocketgs.cli.run_lines import STAGES
from pocketgs.cli.terminal import Terminal
from pocketgs.errors import PocketGSError

if TYPE_CHECKING:
    from pocketgs.viewer.live import LiveRun
    from pocketgs.viewer.server import Page

WHY_A_WARNING = (
    "The browser will warn that the certificate is not trusted: this machine made it, since browsers allow WebGPU over "
    "https only, and no authority certifies addresses in a home network. Continue if it shows the fingerprint"
)


@dataclass(frozen=True)
class PageOptions:
    """Options of the page's server.

    Attributes:
        host: Also serve the local network, over https, so that a phone can show the page; everyone with the printed
            address can see it. Otherwise only this machine can.
        port: Port to listen on; 0 for any free one.
        open: Open the page in the browser.
    """

    host: bool = False
    port: int = 0
    open: bool = True


@dataclass(frozen=True)
class FollowOptions(PageOptions):
    """Options of the page that follows a run.

    Attributes:
        view: Follow the run on a page in the browser: the growing scene, curves, and buttons to pause, resume and stop,
            which keeps what has been trained.
        wait: Keep serving the page after the run, until Ctrl-C; with --no-wait the command and the page end with the
            run.
    """

    view: bool = False
    wait: bool = True


@contextmanager
def following(options: FollowOptions, title: str) -> Iterator[LiveRun | None]:
    """A run that pages can follow, or None without a page. With `wait`, pages are served until Ctrl-C after the block.

    Args:
        options: of the page.
        title: of the page.

    Raises:
        PocketGSError: the page cannot be served, or its options are given without --view.
    """
    if not options.view:
        if options != FollowOptions():
            raise PocketGSError("--host, --port, --no-open and --no-wait concern the page: expected --view with them")
        yield None
        return
    from pocketgs.viewer.live import LiveRun
    from pocketgs.viewer.server import serving

    run = LiveRun(title, STAGES)
    with serving(run, network=options.host, port=options.port) as served:
        announce(served, options)
        yield run
        if options.wait:
            Terminal().say(f"the page stays at {served.url} until Ctrl-C")
            wait_for_ctrl_c()


def announce(served: Page, options: PageOptions) -> None:
    """Print the page's address, and open it."""
    console = Terminal()
    console.say(f"page at {served.url}")
    if served.network_url:
        from pocketgs.viewer.address import qr_code

        console.say(f"in the local network at {served.network_url}")
        if console.is_terminal and console.encoding.lower().startswith("utf"):
            console.print(qr_code(served.network_url), style="bright_white on black")
    if served.fingerprint:
        console.say(f"{WHY_A_WARNING} {served.fingerprint} (SHA-256).")
    if options.open and _has_screen():
        webbrowser.open(served.url)


def _has_screen() -> bool:
    """Whether a browser can open a window; without a screen, some would take over the terminal."""
    return sys.platform in ("win32", "darwin") or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))


def wait_for_ctrl_c() -> None:
    """Return when Ctrl-C is pressed."""
    with suppress(KeyboardInterrupt):
        while True:
            time.sleep(3600)
