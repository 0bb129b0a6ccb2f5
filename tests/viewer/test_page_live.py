"""The page follows a run that really trains, pauses it and lets it go on."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, suppress
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
from aiohttp import web
from playwright.sync_api import Locator, expect

from pocketgs import TrainingOptions
from pocketgs.capture import list_capture
from pocketgs.results.reporter import Reporter
from pocketgs.results.run import run
from pocketgs.scene.formats import ply
from pocketgs.viewer.access import new_token
from pocketgs.viewer.content import Content
from pocketgs.viewer.live import LiveRun
from pocketgs.viewer.routes import application
from pocketgs.viewer.server import Page as Served
from pocketgs.viewer.server import serving, serving_application
from viewer.browsing import NO_GPU, NO_SOCKET, PATIENCE, Visit, open_browser, visiting
from viewer.marks import marked_scene

# One thread, so that the browser gets some of the machine too.
OPTIONS = TrainingOptions(iterations=10**6, prior="none", engine="cpu", threads=1, evaluate_every=50)
SECONDS_OF_PAUSE = 2.0
IMPATIENT = """
const wait = window.setTimeout;
window.setTimeout = (task, milliseconds) => wait(task, milliseconds / 10);
"""
"""A script that lets a page try again sooner."""


def test_page_follows_a_run(written_capture: Path, tmp_path: Path) -> None:
    followed = LiveRun("toys")
    leave = threading.Event()

    def observe(_: object) -> None:
        if leave.is_set():
            raise _LeftError

    def train() -> None:
        reporter = followed.reporter(Reporter(on_progress=observe))
        with suppress(_LeftError):
            run(lambda: list_capture(written_capture), tmp_path / "out", OPTIONS, reporter=reporter)

    training = threading.Thread(target=train)
    with open_browser() as browser, serving(followed) as page, visiting(browser, page.url, 400, 560) as visit:
        training.start()
        try:
            expect(visit["#live"]).to_be_visible(timeout=PATIENCE)
            expect(visit["#stats"]).not_to_be_empty(timeout=PATIENCE)
            expect(visit["#stage"]).to_have_text("training", timeout=PATIENCE)
            expect(visit["#announced"]).to_have_text("training")
            expect(visit["#announced"]).to_have_attribute("role", "status")
            expect(visit["#camera-name"]).to_contain_text("held out")
            expect(visit["#loss"]).not_to_have_text("–", timeout=PATIENCE)
            expect(visit["#psnr"]).to_contain_text("dB", timeout=PATIENCE)
            assert _is_drawn_on(visit["#curves"])

            # A slow GPU's picture gets sharp only while no newer scene comes.
            before = picture_at_rest(visit)
            assert np.ptp(before) > 0.3
            held = visit["#iteration"].inner_text()
            time.sleep(SECONDS_OF_PAUSE)
            assert visit["#iteration"].inner_text() == held

            psnr = visit["#psnr"].inner_text()
            visit["#pause"].click()
            expect(visit["#pause"]).to_have_text("Pause")
            expect(visit["#iteration"]).not_to_have_text(held, timeout=PATIENCE)
            expect(visit["#psnr"]).not_to_have_text(psnr, timeout=PATIENCE)
            assert np.abs(picture_at_rest(visit) - before).max() > 0.02
            assert visit.complaints == []
        finally:
            followed.obey("resume")
            leave.set()
            training.join()


def test_page_without_sockets_follows_a_run_to_its_end(written_capture: Path, tmp_path: Path) -> None:
    """By requests: it shows the figures and the scene, pauses the run, lets it go on, and stops it."""
    followed = LiveRun("toys")
    reporter = followed.reporter(Reporter())

    def train() -> None:
        followed.finish(run(lambda: list_capture(written_capture), tmp_path / "out", OPTIONS, reporter=reporter))

    training = threading.Thread(target=train)
    script = NO_GPU + IMPATIENT + NO_SOCKET
    with open_browser() as browser, serving(followed) as page, visiting(browser, page.url, 400, 560, script) as visit:
        training.start()
        try:
            expect(visit["#psnr"]).to_contain_text("dB", timeout=PATIENCE)
            expect(visit["#loss"]).not_to_have_text("–")
            assert _is_drawn_on(visit["#curves"])
            expect(visit["#camera-name"]).to_contain_text("held out")
            expect(visit["#stats"]).to_contain_text("2,000 splats", timeout=PATIENCE)
            visit["#message-close"].click()
            visit["#pause"].click()
            expect(visit["#stage"]).to_have_text("paused", timeout=PATIENCE)
            time.sleep(SECONDS_OF_PAUSE)  # until the iterations that were under way are reported
            held = followed.news.progress["iteration"]
            time.sleep(SECONDS_OF_PAUSE)
            assert followed.news.progress["iteration"] == held
            visit["#pause"].click()
            expect(visit["#stage"]).to_have_text("training", timeout=PATIENCE)
            expect(visit["#iteration"]).not_to_have_text(f"{held} / {OPTIONS.iterations}", timeout=PATIENCE)
            visit["#stop"].click()
            expect(visit["#stage"]).to_have_text("finished", timeout=PATIENCE)
            expect(visit["#live-buttons"]).to_be_hidden()
            assert [each for each in visit.complaints if "WebGPU" not in each] == []
        finally:
            followed.obey("stop")
            training.join()


def test_pages_that_missed_the_end_of_a_run(tmp_path: Path) -> None:
    """As on a phone that slept: once there is a result they show it, unless the user has opened a file meanwhile."""
    scene, result, opened = marked_scene(), tmp_path / "scene.ply", tmp_path / "opened.ply"
    ply.write_gaussians(result, scene)
    ply.write_gaussians(opened, scene.select(np.arange(3)))
    followed, token = LiveRun("toys"), new_token()

    def served(content: Callable[[], Content], run: LiveRun | None, port: int) -> AbstractContextManager[Served]:
        return serving_application(lambda access: application(access, content, run), port=port, token=token)

    with open_browser() as browser, ExitStack() as server:
        url = server.enter_context(served(lambda: followed.news.content, followed, 0)).url
        port = urlsplit(url).port or 0
        with ExitStack() as visits:
            visit, other = (
                visits.enter_context(visiting(browser, url, 400, 300, NO_GPU + IMPATIENT)) for _ in range(2)
            )
            followed.news.post_progress(stage="training")
            expect(visit["#stage"]).to_have_text("training", timeout=PATIENCE)
            expect(other["#stage"]).to_have_text("training", timeout=PATIENCE)
            other.drop("opened.ply", opened.read_bytes())
            expect(other["#title"]).to_have_text("opened.ply", timeout=PATIENCE)
            server.close()
            expect(visit["#stage"]).to_contain_text("no connection to the computer", timeout=PATIENCE)
            expect(visit["#live-buttons"]).to_be_hidden()
            with served(nothing, None, port):
                expect(visit["#stage"]).to_have_text("ended without a result", timeout=PATIENCE)
                expect(visit["#live-buttons"]).to_be_hidden()
            with served(lambda: Content("toys", result), None, port):
                expect(visit["#stats"]).to_contain_text(f"{len(scene)} splats", timeout=PATIENCE)
                expect(other["#live"]).to_be_hidden(timeout=PATIENCE)
                expect(other["#title"]).to_have_text("opened.ply")


def nothing() -> Content:
    """Refuse, as a server does for a run without a result."""
    raise web.HTTPNotFound


def picture_at_rest(visit: Visit) -> np.ndarray:
    """Pause the run, and wait for the picture of its scene."""
    visit["#pause"].click()
    expect(visit["#pause"]).to_have_text("Resume")
    return visit.picture()


class _LeftError(Exception):
    """Nobody looks any more."""


def _is_drawn_on(canvas: Locator) -> bool:
    return bool(
        canvas.evaluate(
            """canvas => {
                const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
                return data.some((value, i) => i % 4 === 3 && value > 200);
            }"""
        )
    )
