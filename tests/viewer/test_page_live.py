"""The page follows a run that really trains, pauses it and lets it go on."""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
from playwright.sync_api import Locator, expect

from pocketgs import TrainingOptions
from pocketgs.capture import list_capture
from pocketgs.results.reporter import Reporter
from pocketgs.results.run import run
from pocketgs.viewer.live import LiveRun
from pocketgs.viewer.server import serving
from viewer.browsing import PATIENCE, Visit, open_browser, visiting

# One thread, so that the browser gets some of the machine too.
OPTIONS = TrainingOptions(iterations=10**6, prior="none", engine="cpu", threads=1, evaluate_every=100)
SECONDS_OF_PAUSE = 2.0


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
