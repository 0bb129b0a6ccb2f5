"""Following a real training run: messages to pages, commands from pages; training does not wait for them."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import sys
import threading
import time
import warnings
from collections.abc import Callable, Coroutine, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlencode, urlsplit

import numpy as np
import pytest

from pocketgs import Capture, Gaussians, TrainingOptions
from pocketgs.capture import list_capture
from pocketgs.results.reporter import Reporter
from pocketgs.results.run import RunResult, run
from pocketgs.scene.formats.spz import read_gaussians
from pocketgs.scene.warning import SceneWarning
from pocketgs.training.progress import Progress
from pocketgs.viewer import live, news
from pocketgs.viewer.live import LiveRun
from pocketgs.viewer.news import Read
from pocketgs.viewer.server import serving
from viewer.client import Follower, fetch, following, origin_of

# One thread, so that a busy machine does not make the threads wait for each other.
SHORT = TrainingOptions(iterations=300, prior="none", engine="cpu", threads=1, evaluate_every=100)
ENDLESS = replace(SHORT, iterations=10**6)
PATIENCE = 60.0
_Result = TypeVar("_Result")


@contextmanager
def meanwhile(coroutine: Coroutine[Any, Any, _Result]) -> Iterator[Future[_Result]]:
    """Run a page's side of things on another thread: training has this one."""
    result: Future[_Result] = Future()
    training_is_over = threading.Event()

    def work() -> None:
        try:
            result.set_result(asyncio.run(asyncio.wait_for(coroutine, PATIENCE)))
        except BaseException as error:
            result.set_exception(error)
            # Or training would go on for ever. Once it is over, the signal would end the session of tests.
            if not training_is_over.is_set():
                signal.raise_signal(signal.SIGINT)

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield result
    finally:
        training_is_over.set()
        thread.join()


@pytest.fixture
def train(written_capture: Path, tmp_path: Path) -> Callable[..., RunResult]:
    """A function that trains on the small capture and reports to a live run."""

    def call(followed: LiveRun, options: TrainingOptions, reporter: Reporter | None = None) -> RunResult:
        result = run(
            lambda: list_capture(written_capture),
            tmp_path / "out",
            options,
            reporter=followed.reporter(reporter or Reporter()),
        )
        followed.finish(result)
        return result

    return call


@pytest.fixture
def often(monkeypatch: pytest.MonkeyPatch) -> None:
    """As much news as there can be."""
    monkeypatch.setattr(live, "SECONDS_BETWEEN_SCENES", 0.0)
    monkeypatch.setattr(live, "SECONDS_BETWEEN_MESSAGES", 0.0)


@pytest.fixture
def scene() -> Gaussians:
    rng = np.random.default_rng(1)
    return Gaussians(*(rng.normal(size=(9, *tail)) for tail in ((3,), (3,), (4,), (), (1, 3))))


def decoded(encoded: bytes, folder: Path) -> Gaussians:
    path = folder / "told.spz"
    path.write_bytes(encoded)
    return read_gaussians(path)


async def follow_to_the_end(url: str) -> Follower:
    async with following(url) as page:
        last = await page.until(finished=True)
        while not page.scenes or page.scenes[-1][0]["iteration"] < last["iteration"]:
            assert await page.read()
        return page


def test_two_pages_follow_a_run(
    train: Callable[..., RunResult], small_capture: Capture, tmp_path: Path, often: None
) -> None:
    followed = LiveRun("toys", {"evaluation": "looking"})

    async def two_pages(url: str) -> list[Follower]:
        return await asyncio.gather(follow_to_the_end(url), follow_to_the_end(url))

    with serving(followed) as page, meanwhile(two_pages(page.url)) as told:
        while followed.news.readers < 2:
            time.sleep(0.01)
        result = train(followed, SHORT)
    assert result.evaluation
    for follower in told.result():
        last = follower.progress[-1]
        assert (last["iteration"], last["iterations"], last["gaussians"]) == (300, 300, 2000)
        assert (last["stage"], last["paused"], last["seconds_left"]) == ("finished", False, 0)
        assert last["memory_mb"] > 50
        assert last["loss"] > 0
        assert {progress["stage"] for progress in follower.progress} >= {"training", "finished"}
        iterations = [sample["iteration"] for sample in follower.samples]
        assert iterations == sorted(set(iterations))
        assert iterations[-1] == 300
        assert follower.samples[-1]["loss"] < follower.samples[0]["loss"]
        assert follower.samples[-1]["held_out_psnr"] == pytest.approx(result.evaluation.psnr, abs=0.5)
        cameras = follower.viewers[-1]["cameras"]
        assert len(cameras) == len(small_capture.frames)
        assert follower.viewers[-1]["previews"] == ["previews/images_0000.png"]
        assert len(follower.scenes) >= 2
        about, encoded = follower.scenes[-1]
        assert (about["iteration"], about["format"]) == (300, "spz")
        shown = decoded(encoded, tmp_path)
        assert len(shown) == 2000
        np.testing.assert_allclose(np.sort(shown.means, axis=0), np.sort(result.scene.means, axis=0), atol=1e-2)


def test_late_page_is_told_all(train: Callable[..., RunResult], tmp_path: Path) -> None:
    followed = LiveRun("toys")
    with serving(followed) as page:
        result = train(followed, SHORT)
        follower = asyncio.run(follow_to_the_end(page.url))
        assert len(follower.progress) == len(follower.viewers) == 1
        assert follower.samples
        assert fetch(page.url, "viewer.json").json == follower.viewers[0]
        assert follower.viewers[0]["live"] is True
        assert follower.viewers[0]["scene"] is None
        photo, preview = follower.viewers[0]["cameras"][3]["photo"], follower.viewers[0]["previews"][0]
        assert fetch(page.url, photo).body.startswith(b"\xff\xd8")
        assert fetch(page.url, preview).body == (result.folder / "held_out" / "images_0000.png").read_bytes()
    ((about, encoded),) = follower.scenes
    assert (about["iteration"], len(decoded(encoded, tmp_path))) == (300, len(result.scene))


def test_no_scene_is_taken_for_nobody(train: Callable[..., RunResult], often: None) -> None:
    followed = LiveRun("toys")
    scenes: list[object] = []

    def look(progress: Progress) -> None:
        messages, _ = followed.news.since(Read())
        scenes.extend(message for message in messages if isinstance(message, bytes))

    train(followed, SHORT, Reporter(on_progress=look))
    assert scenes == []


def test_pause_resume_and_stop(train: Callable[..., RunResult], often: None) -> None:
    followed = LiveRun("toys")
    done: list[int] = []

    async def a_user(url: str) -> tuple[int, int, int]:
        async with following(url) as page:
            while not page.progress or page.progress[-1]["iteration"] < 5:
                await page.read()
            await page.say("pause")
            await page.until(paused=True)
            await asyncio.sleep(0.3)
            before = done[-1]
            await asyncio.sleep(0.5)
            paused = done[-1]
            # Whoever comes now sees the scene as it stands.
            async with following(url) as other:
                assert (await other.until(paused=True))["finished"] is False
                while not other.scenes:
                    await other.read()
                assert other.scenes[0][0]["iteration"] == paused
                await other.say("resume")
            await page.until(paused=False)
            while page.progress[-1]["iteration"] <= paused:
                await page.read()
            await page.say("stop")
            return before, paused, (await page.until(finished=True))["iteration"]

    reporter = Reporter(on_progress=lambda progress: done.append(progress.iteration))
    with serving(followed) as page, meanwhile(a_user(page.url)) as told:
        result = train(followed, ENDLESS, reporter)
    before, paused, last = told.result()
    assert before == paused < last == result.summary["iterations"] < ENDLESS.iterations
    assert result.summary["interrupted"] is True
    assert (result.folder / "scene.ply").is_file()


def test_stop_while_paused(train: Callable[..., RunResult]) -> None:
    followed = LiveRun("toys")

    async def a_user(url: str) -> None:
        async with following(url) as page:
            await page.say("pause")
            await page.until(paused=True)
            while page.progress[-1]["stage"] != "training":
                await page.read()
            await page.say("stop")
            await page.say("stop")
            await page.until(finished=True)
            await page.say("pause")
            await page.say("stop")

    with serving(followed) as page, meanwhile(a_user(page.url)) as told:
        result = train(followed, ENDLESS)
    told.result()
    assert result.summary["iterations"] == 1
    assert result.summary["interrupted"] is True


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")
def test_ctrl_c_while_paused(train: Callable[..., RunResult]) -> None:
    followed = LiveRun("toys")

    async def a_user(url: str) -> int:
        async with following(url) as page:
            await page.until(stage="training")
            await page.say("pause")
            await page.until(paused=True)
            await asyncio.sleep(0.5)
            os.kill(os.getpid(), signal.SIGINT)
            return (await page.until(finished=True))["iteration"]

    handler = signal.getsignal(signal.SIGINT)
    with serving(followed) as page, meanwhile(a_user(page.url)) as told:
        result = train(followed, ENDLESS)
    assert told.result() == result.summary["iterations"] < ENDLESS.iterations
    assert result.summary["interrupted"] is True
    assert signal.getsignal(signal.SIGINT) is handler


def test_ctrl_c_in_the_step_that_pauses(train: Callable[..., RunResult]) -> None:
    followed = LiveRun("toys")

    def pause_and_press(progress: Progress) -> None:
        if progress.iteration == 5:
            followed.obey("pause")
            signal.raise_signal(signal.SIGINT)

    result = train(followed, ENDLESS, Reporter(on_progress=pause_and_press))
    assert result.summary["iterations"] == 5
    assert result.summary["interrupted"] is True


def test_stop_of_a_run_on_another_thread(train: Callable[..., RunResult]) -> None:
    followed = LiveRun("toys")

    def stop(progress: Progress) -> None:
        if progress.iteration == 5:
            followed.obey("stop")

    with ThreadPoolExecutor(1) as other:
        result = other.submit(train, followed, ENDLESS, Reporter(on_progress=stop)).result(PATIENCE)
    assert result.summary["iterations"] == 5
    assert result.summary["interrupted"] is True


def test_page_that_never_reads_holds_nobody_up(train: Callable[..., RunResult]) -> None:
    followed = LiveRun("toys")
    much = bytes(1 << 25)  # more than what the system takes on behalf of the deaf page

    def show_much(progress: Progress) -> None:
        if progress.iteration % 200 == 20:  # again, for in between comes the scene itself
            followed.news.post_scene(progress.iteration, much)

    async def another_page(url: str) -> int:
        async with following(url) as page:
            while not page.scenes or len(page.scenes[-1][1]) < len(much):
                assert await page.read()
            seen = page.progress[-1]["iteration"]
            while page.progress[-1]["iteration"] < seen + 200:
                assert await page.read()
            await page.say("stop")
            return (await page.until(finished=True))["iteration"]

    with ExitStack() as server, socket.socket() as deaf:
        page = server.enter_context(serving(followed))
        parts = urlsplit(page.url)
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        deaf.settimeout(20)
        deaf.connect((parts.hostname, parts.port))
        handshake = f"GET {parts.path}live HTTP/1.1\r\nHost: {parts.netloc}\r\nOrigin: {origin_of(page.url)}\r\n"
        handshake += "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
        deaf.sendall(f"{handshake}Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n".encode())
        assert deaf.recv(12) == b"HTTP/1.1 101"
        with meanwhile(another_page(page.url)) as told:
            result = train(followed, ENDLESS, Reporter(on_progress=show_much))
        assert told.result() == result.summary["iterations"]
        server.close()
    with pytest.raises(ConnectionError):
        fetch(page.url)


@pytest.mark.parametrize(
    ("message", "code"),
    [
        ("hello", 1008),
        ("{}", 1008),
        ("[]", 1008),
        ('"pause"', 1008),
        ('{"type": "restart"}', 1008),
        ('{"type": ["pause"]}', 1008),
        ('{"type": "pause", "for": 3}', 1008),
        ("[" * 200, 1008),
        (b'{"type": "pause"}', 1008),
        ('{"type": "pause"}' + " " * 300, 1009),
        ("x" * 10**6, 1009),
    ],
)
def test_messages_that_are_none(message: str | bytes, code: int) -> None:
    followed = LiveRun("toys")

    async def say(url: str) -> int | None:
        async with following(url) as page:
            await (page.socket.send_str(message) if isinstance(message, str) else page.socket.send_bytes(message))
            while await page.read():
                pass
            return page.socket.close_code

    with serving(followed) as page:
        assert asyncio.run(say(page.url)) == code
        assert "'paused': False" in str(followed.news.since(Read()))
        deadline = time.monotonic() + 10
        while followed.news.readers and time.monotonic() < deadline:
            time.sleep(0.01)
        assert not followed.news.readers


def test_pages_are_told_that_the_server_ends() -> None:
    followed = LiveRun("toys")
    told: list[int | None] = []

    async def listen(url: str) -> None:
        async with following(url) as page:
            while await page.read():
                pass
            told.append(page.socket.close_code)

    with serving(followed) as page:
        thread = threading.Thread(target=lambda: asyncio.run(listen(page.url)))
        thread.start()
        while not followed.news.readers:
            time.sleep(0.01)
    thread.join(timeout=10)
    assert told == [1001]


def test_page_is_told_the_end_before_the_server_ends(train: Callable[..., RunResult]) -> None:
    followed = LiveRun("toys")
    with ExitStack() as server:
        page = server.enter_context(serving(followed))
        with meanwhile(follow_to_the_end(page.url)) as told:
            train(followed, SHORT)
            server.close()
    assert told.result().scenes[-1][0]["iteration"] == 300


def test_a_page_that_polls(train: Callable[..., RunResult], tmp_path: Path, often: None) -> None:
    """It gets what is new, and scenes are taken for it."""
    followed = LiveRun("toys")
    with serving(followed) as page:
        first = fetch(page.url, "news.json").json
        assert [message["type"] for message in first["messages"]] == ["progress"]
        assert fetch(page.url, "snapshot.spz").status == 404
        assert fetch(page.url, f"news.json?{urlencode(first['read'])}").json == {"read": first["read"], "messages": []}
        result = train(followed, SHORT)
        told = fetch(page.url, f"news.json?{urlencode(first['read'])}").json
        cameras, progress, scene = told["messages"]
        assert (cameras["type"], len(cameras["viewer"]["cameras"])) == ("cameras", 8)
        assert (progress["type"], progress["finished"], progress["samples"][-1]["iteration"]) == ("progress", True, 300)
        assert (scene["type"], scene["format"], scene["iteration"]) == ("scene", "spz", 300)
        assert told["read"]["scene"] > 1
        encoded = fetch(page.url, "snapshot.spz").body
        assert (len(encoded), len(decoded(encoded, tmp_path))) == (scene["bytes"], len(result.scene))
        for wrong in ("content=x", "samples=", "scene=1.5", "progress=9" + "9" * 5000):
            assert fetch(page.url, f"news.json?{wrong}").status == 400, wrong


def test_pages_that_poll_count_for_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    """A page may leave without a word. Programs that ask for the progress only are no pages."""
    followed = LiveRun("toys")
    with serving(followed) as page:
        fetch(page.url, "progress.json")
        assert not followed.news.readers
        fetch(page.url, "news.json")
        assert followed.news.readers == 1
        monkeypatch.setattr(news, "SECONDS_TO_POLL", 0.0)
        assert not followed.news.readers


def test_refined_poses_are_shown(small_capture: Capture) -> None:
    pose = small_capture.train[0].camera.world_to_camera.copy()
    pose[:3, 3] += 0.01
    name = small_capture.train[0].name
    moved = small_capture.with_refined_poses({name: replace(small_capture.train[0].camera, world_to_camera=pose)})
    followed = LiveRun("toys")
    reporter = followed.reporter(Reporter())
    reporter.on_capture(small_capture)
    reporter.on_prepared(moved)
    (camera,) = (camera for camera in followed.news.content.to_json()["cameras"] if camera["name"] == name)
    assert np.array_equal(np.reshape(camera["world_to_camera"], (4, 4)), pose)


def shown_at_the_end(followed: LiveRun, scene: Gaussians, folder: Path) -> Gaussians | None:
    """The scene that pages get when a run of 7 iterations ends with this one."""
    followed.finish(RunResult(folder, scene, None, {"iterations": 7}))
    messages, _ = followed.news.since(Read())
    encoded = [message for message in messages if isinstance(message, bytes)]
    return decoded(encoded[0], folder) if encoded else None


def test_a_few_bad_gaussians_do_not_keep_the_others_from_pages(scene: Gaussians, tmp_path: Path) -> None:
    """Such as one that NaN has reached, and one that .spz cannot place."""
    followed, said = LiveRun("toys"), list[str]()
    followed.reporter(Reporter(on_warning=said.append))
    scene.means[3], scene.means[5, 1], scene.log_scales[6] = np.nan, -8.4e6, np.inf
    scene.quaternions[8] = 0.0
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", SceneWarning)
        shown = shown_at_the_end(followed, scene, tmp_path)
        # The largest coordinate that can be held: steps are coarse, but there is no file that the user could change.
        scene.means[5, 1] = -8_388_607.0
        far = shown_at_the_end(LiveRun("toys"), scene, tmp_path)
    assert shown is not None
    assert far is not None
    assert (len(shown), len(far)) == (len(scene) - 3, len(scene) - 2)
    np.testing.assert_allclose(shown.means, np.delete(scene.means, [3, 5, 6], axis=0), atol=1e-3)
    assert not said
    assert not caught


def test_scene_that_cannot_be_shown_is_a_warning(scene: Gaussians, tmp_path: Path) -> None:
    for diverged in (np.inf, 1e30):
        followed, said = LiveRun("toys"), list[str]()
        followed.reporter(Reporter(on_warning=said.append))
        scene.means[:] = diverged
        assert shown_at_the_end(followed, scene, tmp_path) is None
        assert len(said) == 1
        assert "iteration 7 cannot be shown on the page" in said[0]


def test_how_far_a_stage_is(often: None) -> None:
    """Searching for poses takes minutes before there is a step to show."""
    shown: list[tuple[int, int]] = []
    followed = LiveRun("toys", {"features": "finding features"})
    reporter = followed.reporter(Reporter(on_count=lambda done, of: shown.append((done, of))))
    with serving(followed) as page:
        assert fetch(page.url, "progress.json").json["stage"] == "starting"
        reporter.on_stage("features")
        reporter.on_count(3, 84)
        assert fetch(page.url, "progress.json").json["stage"] == "finding features: 3 of 84"
        reporter.on_stage("matching")
        assert fetch(page.url, "progress.json").json["stage"] == "matching"
    assert shown == [(3, 84)]
