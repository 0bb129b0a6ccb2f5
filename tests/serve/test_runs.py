"""Real runs: one at a time, stopped and kept, failed, and gone on with by the next server."""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from urllib.parse import urlencode

import psutil
import pytest
from aiohttp import ClientConnectionError

from pocketgs.serve import child, training
from pocketgs.serve.child import ORPHANED
from pocketgs.serve.entry import Entry, State, UploadedFile, read_entry
from pocketgs.serve.server import ServeOptions, serving_folder
from pocketgs.serve.shelf import Shelf, new_id
from pocketgs.serve.training import Training
from serve.client import Phone
from serve.conftest import MINIMAL
from viewer.client import fetch, following
from zip_files import zip_of

ENDLESS = (*MINIMAL, "--iterations", "1000000")
FLAGS = {"quick": (*MINIMAL, "--iterations", "20"), "best": ENDLESS, "broken": ("--images", "none")}


def is_training(capture: dict) -> bool:
    return bool(capture["state"] == "training" and capture["progress"]["iteration"])


def command_of(folder: Path, identity: str) -> list[str]:
    """The command of a run that goes on."""
    process = read_entry(folder / "captures" / identity / "about.json").process
    assert process
    return psutil.Process(process).cmdline()


def working_at(identity: str) -> list[psutil.Process]:
    """The processes that check or train a capture."""
    found = []
    for process in psutil.Process().children(recursive=True):
        with suppress(psutil.Error):
            found += [process] if any(identity in argument for argument in process.cmdline()) else []
    return found


def until_there(phone: Phone, identity: str, path: Path) -> None:
    """Wait until a check has come so far that it has written a file or folder."""
    while not path.exists():
        assert phone.capture(identity)["state"] == "checking"
        time.sleep(0.01)


async def watch(url: str) -> None:
    """Follow a run until a scene has come."""
    async with following(url) as page:
        while not page.scenes:
            assert await page.read()
        about, encoded = page.scenes[-1]
        assert (about["format"], about["bytes"]) == ("spz", len(encoded))


def check_commands(phone: Phone, identity: str) -> None:
    """A page without WebSockets sends them in requests, which reach the run's page; nothing else is passed on."""
    view = f"captures/{identity}/view"
    paused = {"type": "pause"}
    assert phone.tell(f"{view}/live", paused, Origin="https://evil.example").status == 403
    assert phone.tell(f"/wrong/{view}/live", paused).status == 403
    assert phone.tell(f"{view}/live", {"type": "restart"}).status == 400
    assert phone.tell(f"{view}/live", "x" * 300).status == 413
    for path in ("viewer.json", "news.json", "snapshot.spz"):
        assert phone.tell(f"{view}/{path}", paused).status == 405
    assert phone.tell(f"{view}/live/x", paused).status == 404
    news = fetch(phone.url, f"{view}/news.json").json
    assert not any(message.get("paused") for message in news["messages"])
    assert phone.tell(f"{view}/live", paused).status == 204
    changed = fetch(phone.url, f"{view}/news.json?{urlencode(news['read'])}").json["messages"]
    assert any(message.get("paused") for message in changed)
    phone.until(identity, lambda _: fetch(phone.url, f"{view}/snapshot.spz").status == 200)
    assert phone.tell(f"{view}/live", {"type": "resume"}).status == 204
    assert phone.tell("captures/0123456789ab/view/live", paused).status == 404


def test_one_after_the_other(folder: Path, zipped: bytes) -> None:
    """A run that fails, and one that the server is ended in, do not keep others from being trained."""
    with serving_folder(folder, ServeOptions(FLAGS, "quick")) as (page, _):
        phone = Phone(page.url)
        failing = phone.upload({"toys.zip": zipped}, title="fails", effort="broken")
        phone.until(failing, "training")
        long = phone.upload({"toys.zip": zipped}, title="long", effort="best")
        told = phone.until(failing, "failed")
        assert "none" in told["message"]
        assert str(folder) not in told["message"]
        phone.until(long, is_training)
        viewer = fetch(phone.url, f"captures/{long}/view/viewer.json").json
        assert (viewer["title"], viewer["live"], len(viewer["cameras"])) == ("long", True, 8)
        assert fetch(phone.url, f"captures/{long}/view/photos/0.jpg").status == 200
        live = f"captures/{long}/view/live"
        assert fetch(phone.url, live, headers={"Origin": "https://evil.example"}).status == 403
        check_commands(phone, long)
        asyncio.run(asyncio.wait_for(watch(f"{phone.url}captures/{long}/view/"), 60))
        process = read_entry(folder / "captures" / long / "about.json").process
        assert process
        assert psutil.pid_exists(process)
    # It was ended as Ctrl-C does: what was trained is kept, and the run is queued.
    assert not psutil.pid_exists(process)
    record = folder / "captures" / long / "result" / "run.json"
    done = json.loads(record.read_text())["iterations"]
    assert done > 0
    entry = Shelf(folder).entries[long]
    assert (entry.state, entry.process) == ("queued", None)
    # The next server has other options, which the checkpoint does not fit.
    others = {**FLAGS, "best": (*ENDLESS, "--max-size", "90")}
    with serving_folder(folder, ServeOptions(others, "quick")):
        assert phone.until(long, is_training)["progress"]["iteration"] > done, "it goes on where it ended"
        assert "--resume" in command_of(folder, long)
        assert "90" not in command_of(folder, long)
        assert phone.tell(f"captures/{long}/stop").status == 200
        told = phone.until(long, "trained")
        assert told["result"]["interrupted"]
        assert told["can_go_on"]
        assert told["result"]["iterations"] > done
        scene = fetch(phone.url, f"captures/{long}/scene.ply").body
        assert scene == (folder / "captures" / long / "result" / "scene.ply").read_bytes()
        phone.tell(f"captures/{long}/train", {"effort": "best"})
        phone.until(long, is_training)
        anew = command_of(folder, long)
        assert "--resume" not in anew, "it begins anew"
        assert "90" in anew
        phone.tell(f"captures/{long}/stop")
        phone.until(long, "trained")
        phone.tell(f"captures/{long}/go-on")
        phone.until(long, is_training)
        assert command_of(folder, long) == [*anew, "--resume"]


EVALUATES_SLOWLY = """
import runpy, sys, time
from pathlib import Path
import pocketgs.results.run as run

def evaluate(*given, **options):
    Path(sys.argv[0]).with_suffix(".evaluating").touch()
    time.sleep(3)
    return evaluate_held_out(*given, **options)

evaluate_held_out, run.evaluate_held_out = run.evaluate_held_out, evaluate
runpy.run_module("pocketgs", run_name="__main__")
"""


def test_ending_the_server_while_a_result_is_written(
    folder: Path, zipped: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The run has written all of its result when it ends, and is not begun anew."""
    script = tmp_path / "slow.py"
    script.write_text(EVALUATES_SLOWLY)

    async def start(arguments: Sequence[str], folder: Path) -> asyncio.subprocess.Process:
        command = ("-m", *arguments) if arguments[0] != "pocketgs" else (str(script), *arguments[1:])
        output = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
        return await asyncio.create_subprocess_exec(sys.executable, *command, cwd=folder, **output)

    monkeypatch.setattr(child, "start", start)
    with serving_folder(folder, ServeOptions(FLAGS, "quick")) as (page, _):
        phone = Phone(page.url)
        identity = phone.upload({"toys.zip": zipped})
        phone.until(identity, lambda _: script.with_suffix(".evaluating").exists())
    entry = Shelf(folder).entries[identity]
    assert (entry.state, entry.process) == ("trained", None)


def test_deleting_what_trains(folder: Path, zipped: bytes) -> None:
    """The run ends at once; restored, the capture is queued again."""
    with serving_folder(folder, ServeOptions(FLAGS, "quick")) as (page, _):
        phone = Phone(page.url)
        identity = phone.upload({"toys.zip": zipped}, effort="best")
        about = folder / "captures" / identity / "about.json"
        phone.until(identity, lambda _: read_entry(about).process is not None)
        process = read_entry(about).process
        assert process
        assert phone.tell(f"captures/{identity}/delete").status == 200
        assert not psutil.pid_exists(process)
        assert phone.shelf["captures"] == []
        phone.tell(f"captures/{identity}/restore")
        phone.until(identity, "training")
        phone.tell(f"captures/{identity}/stop")
        assert phone.until(identity, "stopped")["result"] is None
        # A run that is killed, for lack of memory for example, has failed.
        phone.tell(f"captures/{identity}/train", {"effort": "best"})
        phone.until(identity, lambda _: read_entry(about).process is not None)
        killed = read_entry(about).process
        assert killed
        psutil.Process(killed).kill()
        told = phone.until(identity, "failed")
        assert told["message"].startswith("training ended with status")
        assert fetch(phone.url, "shelf.json").status == 200


def test_stopping_a_run_that_does_not_answer(
    serve: Callable[..., Phone], zipped: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody is told that it is stopped and kept. One that has just ended by itself need not be stopped any more."""
    has_ended = False

    async def obey(run: Training, _: str) -> None:
        if has_ended:
            psutil.Process(run.process).kill()
        raise ClientConnectionError

    phone = serve()
    identity = phone.upload({"toys.zip": zipped}, effort="best")
    phone.until(identity, is_training)
    monkeypatch.setattr(Training, "obey", obey)
    monkeypatch.setattr(training, "SECONDS_TO_END", 0.1)
    answer = phone.tell(f"captures/{identity}/stop")
    assert (answer.status, answer.json) == (503, {"error": "the run does not answer: try again"})
    monkeypatch.setattr(training, "SECONDS_TO_END", 5.0)
    has_ended = True
    answer = phone.tell(f"captures/{identity}/stop")
    assert (answer.status, answer.json) == (200, {})
    phone.until(identity, "failed")


def test_a_log_that_cannot_be_written(folder: Path, serve: Callable[..., Phone], zipped: bytes) -> None:
    """The run needs none."""
    phone = serve()
    begun = phone.begin({"toys.zip": zipped}).json
    (folder / "captures" / begun["id"] / "train.log").mkdir()
    phone.put(begun["id"], 1, 0, zipped)
    phone.until(begun["id"], lambda capture: capture["state"] in ("trained", "failed"))
    assert phone.capture(begun["id"])["state"] == "trained"


def test_a_run_that_cannot_be_followed(
    serve: Callable[..., Phone], zipped: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever goes wrong in the server, the run ends before the next one begins."""

    async def fail(_: Training, __: Path) -> int:
        raise RuntimeError("cannot follow")

    monkeypatch.setattr(Training, "finish", fail)
    phone = serve()
    identity = phone.upload({"toys.zip": zipped}, effort="best")
    assert phone.until(identity, "failed")["message"] == "RuntimeError: cannot follow"
    assert working_at(identity) == []


@pytest.mark.usefixtures("untrained")
def test_what_a_killed_server_leaves(folder: Path, serve: Callable[..., Phone]) -> None:
    """Its run goes on without it: the next server ends that, and queues the capture. Other processes are spared."""
    files = (UploadedFile("a.mov", "0001.mov", 5),)
    left = Entry(new_id(), "left", "video", files, "quick", 1.0, "training")
    result = folder.resolve() / "captures" / left.id / "result"
    with subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)", str(result)]) as run:
        shelf = Shelf(folder)
        left = replace(left, process=run.pid)
        other = replace(left, id=new_id(), title="other", process=os.getpid())
        ended = replace(left, id=new_id(), title="ended", process=2**22 + 1)
        for entry in (left, other, ended):
            shelf.add(entry)
        phone = serve()
        assert {each["title"]: each["state"] for each in phone.shelf["captures"]} == dict.fromkeys(
            ("left", "other", "ended"), "queued"
        )
        assert run.wait(10) != 0


def test_an_effort_that_is_no_more_offered(folder: Path, serve: Callable[..., Phone]) -> None:
    """Such as of an earlier version: the capture fails with a reason, and the others go on."""
    shelf = Shelf(folder)
    files = (UploadedFile("a.mov", "0001.mov", 5),)
    entry = Entry(new_id(), "old", "video", files, "heroic", 1.0, "queued")
    shelf.add(entry)
    assert "effort 'heroic', expected one of quick" in serve().until(entry.id, "failed")["message"]


@pytest.mark.usefixtures("untrained")
@pytest.mark.parametrize("state", ["uploading", "checking"])
def test_a_check_that_was_cut_off(folder: Path, serve: Callable[..., Phone], zipped: bytes, state: State) -> None:
    """While it went on, or when all had arrived and it was about to begin."""
    shelf = Shelf(folder)
    files = (UploadedFile("a.zip", "0001.zip", len(zipped)),)
    entry = Entry(new_id(), "toys", "archive", files, "quick", 1.0, state)
    shelf.add(entry)
    place = shelf.place(entry)
    (place / "upload" / "0001.zip").write_bytes(zipped)
    (place / "unpacking" / "images").mkdir(parents=True)
    serve().until(entry.id, "queued")
    assert not (place / "unpacking").exists()
    assert (place / "capture" / "toys" / "cloud.ply").is_file()


def test_a_server_that_is_killed_while_it_checks(folder: Path) -> None:
    """The check ends too: it would unpack into the folder in which the next server checks again."""
    command = [sys.executable, "-m", "pocketgs", "serve", str(folder), "--no-host", "--no-open"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout
        try:
            phone = Phone(server.stdout.readline().removeprefix("page at ").strip())
            identity = phone.upload({"toys.zip": zip_of({f"toys/{number}/a.txt": b"a" for number in range(20_000)})})
            place = folder / "captures" / identity
            until_there(phone, identity, place / "unpacking" / "toys" / "9")
            checking = working_at(identity)
            assert checking
        finally:
            server.kill()
    assert psutil.wait_procs(checking, timeout=60)[1] == []
    assert not (place / "capture").exists(), "it did not wait until all was unpacked"


def test_a_server_that_is_killed_before_its_check_begins() -> None:
    gone = 2**22 + 1
    program = f"import time; from pocketgs.serve.child import exit_when_gone; exit_when_gone({gone}); time.sleep(600)"
    assert subprocess.run([sys.executable, "-c", program], timeout=60, check=False).returncode == ORPHANED


@pytest.mark.usefixtures("untrained")
def test_deleting_what_is_checked(serve: Callable[..., Phone], photographs: dict[str, bytes]) -> None:
    """The check is cut off: what it may say does not count."""
    phone = serve()
    identity = phone.upload(photographs)
    for _ in range(3):
        assert phone.tell(f"captures/{identity}/delete").status == 200
        assert phone.tell(f"captures/{identity}/restore").status == 200
    assert phone.until(identity, lambda capture: capture["state"] != "checking")["state"] == "queued"


@pytest.mark.usefixtures("untrained")
def test_deleting_what_is_unpacked(folder: Path, serve: Callable[..., Phone]) -> None:
    """The check ends before the folder is moved, so nothing of it comes back; restored, it is checked again."""
    phone = serve()
    identity = phone.upload({"toys.zip": zip_of({f"toys/{number}/a.txt": b"a" for number in range(2_000)})})
    place = folder / "captures" / identity
    until_there(phone, identity, place / "unpacking" / "toys" / "9")
    assert phone.tell(f"captures/{identity}/delete").status == 200
    assert working_at(identity) == []
    assert not place.exists()
    assert phone.tell(f"captures/{identity}/restore").status == 200
    assert "not a capture" in phone.until(identity, "unusable")["message"]
