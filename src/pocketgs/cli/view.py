"""`pocketgs view`, and the page that follows a run."""

from __future__ import annotations

import os
import sys
import time
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from pocketgs.cli.capture_options import CaptureOptions
from pocketgs.cli.display import STAGES
from pocketgs.cli.scene_file import in_world_of, load_scene
from pocketgs.cli.terminal import Terminal
from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import DEFAULT_MB, memory_bound
from pocketgs.files.opening import reading_inside
from pocketgs.results.folder import SCENE

if TYPE_CHECKING:
    from pocketgs.viewer.live import LiveRun
    from pocketgs.viewer.server import Page

WHY_A_WARNING = (
    "The browser will warn that the certificate is not to be trusted: this machine made it for itself, since browsers "
    "give WebGPU to https only, and nobody vouches for addresses in a home network. Go on if it shows the fingerprint"
)


@dataclass(frozen=True)
class PageOptions:
    """Where the page is served.

    Attributes:
        host: Serve the local network too, over https, so that a phone can show the page; whoever has the printed
            address can see it. Otherwise only this machine can.
        port: Port to listen at; 0 for any that is free.
        open: Open the page in the browser.
    """

    host: bool = False
    port: int = 0
    open: bool = True


@dataclass(frozen=True)
class FollowOptions(PageOptions):
    """Whether and where a page follows the run.

    Attributes:
        view: Follow the run on a page in the browser: the scene as it grows, its curves, pause, resume, and stop, which
            keeps what has been trained.
        wait: Keep the page once the run has ended, until Ctrl-C; with --no-wait the command ends with the run, and the
            page with it.
    """

    view: bool = False
    wait: bool = True


def view(
    scene: Annotated[Path, tyro.conf.Positional],
    capture: Path | None = None,
    max_memory: int = DEFAULT_MB,
    page: PageOptions = PageOptions(),
    reading: CaptureOptions = CaptureOptions(),  # noqa: B008 - a frozen dataclass
) -> None:
    """Show a scene in the browser, until Ctrl-C.

    Args:
        scene: A file with Gaussians, or a result folder.
        capture: The capture's folder or its transforms.json, for its cameras and for photographs to compare with.
        max_memory: Megabytes that reading may take; what would take more is refused.
        page: Where the page is served.
        reading: How to read the capture.
    """
    from pocketgs.viewer.readable import readable_file
    from pocketgs.viewer.scene_content import scene_content
    from pocketgs.viewer.server import serving

    with memory_bound(max_memory):
        with reading_inside(scene if scene.is_dir() else None):
            gaussians = load_scene(scene)
        opened = in_world_of(scene, reading.open(capture)) if capture else None
    if len(gaussians) == 0:
        raise PocketGSError(f"{scene}: holds no Gaussian, expected at least one")
    is_result = scene.is_dir()
    title = scene.resolve().name if is_result else scene.stem
    with readable_file(scene / SCENE if is_result else scene, gaussians) as file:
        content = scene_content(title, file, gaussians, scene if is_result else None, opened)
        with serving(content, network=page.host, port=page.port) as served:
            _announce(served, page)
            Terminal().say("Ctrl-C ends it")
            _wait_for_ctrl_c()


@contextmanager
def following(options: FollowOptions, title: str) -> Iterator[LiveRun | None]:
    """A run for the block to report to, or None without a page. With `wait` it is served until Ctrl-C after the block.

    Args:
        options: whether and where.
        title: of the page.

    Raises:
        PocketGSError: it cannot be served, or there is to be none and yet options for it.
    """
    if not options.view:
        if options != FollowOptions():
            raise PocketGSError("--host, --port, --no-open and --no-wait are about the page: expected --view with them")
        yield None
        return
    from pocketgs.viewer.live import LiveRun
    from pocketgs.viewer.server import serving

    run = LiveRun(title, STAGES)
    with serving(run, network=options.host, port=options.port) as served:
        _announce(served, options)
        yield run
        if options.wait:
            Terminal().say(f"the page stays at {served.url} until Ctrl-C")
            _wait_for_ctrl_c()


def _announce(served: Page, options: PageOptions) -> None:
    """Say where the page is, and open it."""
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
    """Whether a browser has a window to open; without one, some would take over the terminal."""
    return sys.platform in ("win32", "darwin") or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))


def _wait_for_ctrl_c() -> None:
    with suppress(KeyboardInterrupt):
        while True:
            time.sleep(3600)
