"""Ctrl-C, SIGTERM and kills, sent to processes that are really training."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pocketgs import Gaussians

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")

# One thread, so that a busy machine does not make the threads wait for each other.
ENDLESS = ["--prior", "none", "--iterations", 1_000_000, "--threads", 1]
WITH_THE_DEMO_THAT_IS_THERE = (
    "import pocketgs.cli.commands.demo; from pocketgs.cli import main\n"
    "pocketgs.cli.commands.demo.write_demo = lambda folder: None\n"
    "main()"
)
WITH_MANY_CHECKPOINTS = (
    "from pocketgs.cli import main; from pocketgs.results import checkpoint\n"
    "checkpoint.SECONDS_BETWEEN_CHECKPOINTS = 0.0\n"
    "main()"
)


def wait_until_it_trains(process: subprocess.Popen[str]) -> None:
    assert process.stdout
    for line in process.stdout:
        if line.startswith("iteration "):
            return
    pytest.fail(f"ended before it trained: {process.communicate()[1]}")


@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_result_is_written(
    pocketgs_process: Callable[..., subprocess.Popen[str]],
    written_capture: Path,
    small_demo: Path,
    tmp_path: Path,
    stop: signal.Signals,
) -> None:
    output = tmp_path / "result"
    # Ctrl-C goes to the demo, as a user would meet it first.
    demo = stop == signal.SIGINT
    command = ["demo", "--capture", small_demo / "capture"] if demo else ["train", written_capture]
    process = pocketgs_process(*command, "--output", output, *ENDLESS, program=WITH_THE_DEMO_THAT_IS_THERE)
    wait_until_it_trains(process)
    process.send_signal(stop)
    printed, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (0, "")
    assert "(stopped early)" in printed
    record = json.loads((output / "run.json").read_text())
    assert record["interrupted"] is True
    assert 100 <= record["iterations"] < 1_000_000
    # The demo's poses drift, and it brings no points.
    assert record["psnr"] > (12 if demo else 20)
    assert len(Gaussians.load(output / "scene.ply")) == record["gaussians"]
    assert sorted(path.name for path in output.iterdir()) == [
        ".pocketgs",
        "cameras.json",
        "checkpoint.npz",
        "held_out",
        "run.json",
        "scene.ply",
    ]


def test_ctrl_c_before_training_ends_it_at_once(
    pocketgs_process: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    program = (
        "import signal; import pocketgs.capture.synthetic.recording as recording; from pocketgs.cli import main\n"
        # A shell starts jobs in the background with Ctrl-C ignored.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "recording.room = lambda: signal.raise_signal(signal.SIGINT)\n"
        "main()"
    )
    command = ["demo", "--output", tmp_path / "result", "--capture", tmp_path / "capture"]
    process = pocketgs_process(*command, program=program)
    _, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (130, "pocketgs: stopped\n")
    assert list(tmp_path.iterdir()) == []


AT_AN_IMPORT = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
class Press:
    def find_spec(self, name, path=None, target=None):
        if name == "tyro":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Press())
from pocketgs.__main__ import main
main()
"""
AT_THE_END = """
import atexit, os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
atexit.register(os.kill, os.getpid(), signal.SIGINT)
from pocketgs.__main__ import main
main()
"""


@pytest.mark.parametrize(
    ("program", "command"),
    [
        (AT_AN_IMPORT, "bench --list"),
        (AT_AN_IMPORT, "view none"),
        (AT_AN_IMPORT, "pose none --output none"),
        (AT_THE_END, "info none"),
    ],
)
def test_ctrl_c_while_nothing_is_done_is_one_line(
    pocketgs_process: Callable[..., subprocess.Popen[str]], program: str, command: str
) -> None:
    process = pocketgs_process(*command.split(), program=program)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 130
    assert errors.splitlines()[-1] == "pocketgs: stopped"
    assert "Traceback" not in errors
    assert "ignored" not in errors


TWICE_WHILE_A_THREAD_WORKS = """
import os, signal, threading
from concurrent.futures import ThreadPoolExecutor
import cv2, numpy
import pocketgs.capture.synthetic.recording as recording
signal.signal(signal.SIGINT, signal.default_int_handler)
def work():
    image = numpy.zeros((64, 64))
    while True:
        cv2.blur(image, (3, 3))
def room():
    with ThreadPoolExecutor(1) as pool:
        pool.submit(work)
        threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
        signal.raise_signal(signal.SIGINT)  # leaves the block, which waits for the thread until the other comes
recording.room = room
from pocketgs.__main__ import main
main()
"""


def test_ctrl_c_twice_while_a_thread_works_is_one_line(
    pocketgs_process: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    command = ["demo", "--output", tmp_path / "result", "--capture", tmp_path / "capture"]
    process = pocketgs_process(*command, program=TWICE_WHILE_A_THREAD_WORKS)
    try:
        _, errors = process.communicate(timeout=60)
    finally:
        process.kill()
    assert (process.returncode, errors) == (130, "pocketgs: stopped\n")
    assert list(tmp_path.iterdir()) == []


def test_sigterm_before_training_is_ctrl_c(
    pocketgs_process: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    program = (
        "import signal; import pocketgs.capture.synthetic.recording as recording\n"
        "signal.signal(signal.SIGINT, signal.SIG_IGN)\n"  # as under nohup
        "recording.room = lambda: signal.raise_signal(signal.SIGTERM)\n"
        "from pocketgs.__main__ import main; main()"
    )
    command = ["demo", "--output", tmp_path / "result", "--capture", tmp_path / "capture"]
    process = pocketgs_process(*command, program=program)
    _, errors = process.communicate(timeout=120)
    assert (process.returncode, errors) == (130, "pocketgs: stopped\n")
    assert list(tmp_path.iterdir()) == []


def test_kill_leaves_the_earlier_result(
    pocketgs_process: Callable[..., subprocess.Popen[str]],
    written_capture: Path,
    result: Path,
    contents: Callable[[Path], dict[str, bytes]],
) -> None:
    before = contents(result)
    process = pocketgs_process("train", written_capture, "--output", result, *ENDLESS)
    wait_until_it_trains(process)
    process.kill()
    process.communicate()
    # The lock's file stays, and nobody holds it.
    assert contents(result) == {**before, ".pocketgs/lock": b""}


def test_killed_run_goes_on_from_its_last_checkpoint(
    pocketgs_process: Callable[..., subprocess.Popen[str]],
    written_capture: Path,
    result: Path,
    contents: Callable[[Path], dict[str, bytes]],
) -> None:
    before = contents(result)
    command = ["train", written_capture, "--prior", "none", "--output", result]
    process = pocketgs_process(*command, "--iterations", 100_000, program=WITH_MANY_CHECKPOINTS)
    unfinished, deadline = result / "unfinished.npz", time.monotonic() + 60
    while not unfinished.exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(0.2)
    process.kill()
    process.communicate()
    # What was being written when the kill came may lie beside the rest, but nothing of the earlier result changes.
    assert before.items() <= contents(result).items()
    leftover = result / ".unfinished.0123abcd.partial.npz"
    leftover.touch()
    with np.load(unfinished) as data:
        done = int(data["iteration"])
    resumed = pocketgs_process(*command, "--iterations", done + 3, "--resume")
    resumed.communicate()
    assert resumed.returncode == 0
    record = json.loads((result / "run.json").read_text())
    assert (record["resumed_from"], record["iterations"]) == (done, done + 3)
    assert sorted(path.name for path in result.iterdir()) == [
        ".pocketgs",
        "cameras.json",
        "checkpoint.npz",
        "held_out",
        "run.json",
        "scene.ply",
    ]


def test_on_a_terminal(written_capture: Path, tmp_path: Path) -> None:
    """When progress is redrawn in place."""
    pty = pytest.importorskip("pty")
    try:
        terminal, ours = pty.openpty()
    except OSError as error:
        pytest.skip(f"this system gives no pseudo-terminals: {error}")
    options = ["--max-gaussians", 2000, "--iterations", 60, "--evaluate-every", 20]
    command = ["train", written_capture, "--output", tmp_path / "result", *options]
    process = subprocess.Popen(
        [sys.executable, "-m", "pocketgs", *map(str, command)], stdin=ours, stdout=ours, stderr=ours
    )
    os.close(ours)
    shown = b""
    try:
        while piece := os.read(terminal, 65536):
            shown += piece
    except OSError:  # Linux says so when the other end has been closed
        pass
    os.close(terminal)
    text = shown.decode()
    assert process.wait(60) == 0, text
    assert "Traceback" not in text
    assert "prior: " in text
    assert " keyframes of 7 frames" in text
    record = json.loads((tmp_path / "result" / "run.json").read_text())
    assert f"60 iterations, {record['gaussians']:,} Gaussians" in text
