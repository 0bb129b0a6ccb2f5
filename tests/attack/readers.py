"""An attack on the readers: captures, results and scenes with something broken, thousands of them.

    python tests/attack/readers.py --seconds 60
    python tests/attack/readers.py --cases 10000 --seed 0

Each case is a sound example of which one file is broken, and must end in what it holds or in a `PocketGSError`, within
a time and in a memory that fit a file of a few kilobytes. What ends otherwise is kept, printed, and makes the exit
status 1. A case follows from the seed and its number alone: `--first 1234 --cases 1` repeats it.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import shutil
import sys
import tempfile
import time
import traceback
from collections import Counter
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from random import Random
from typing import Literal

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from attack.mutations import break_tree, mutated
from attack.originals import small_capture, write_captures, write_result, write_scenes
from pocketgs.capture import open_capture
from pocketgs.cli.scene_file import load_any
from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import memory_bound
from pocketgs.scene.formats import read_scene
from pocketgs.system.process import peak_rss_mb
from pocketgs.viewer.scene_content import scene_content

SECONDS_A_CASE = 20.0
BOUND_MB, MAX_MB = 200, 500
"""Memory bound of the readers, and growth of the process that counts as a failure."""

MAX_ERROR = 2000

Kind = Literal["capture", "scene", "result"]


@dataclass(frozen=True)
class Original:
    """A valid example: its path, the folder of all its files, and the function that opens it."""

    name: str
    kind: Kind
    path: Path
    folder: Path


@dataclass(frozen=True)
class Outcome:
    """Outcome of a case: "read", "refused", or an error."""

    number: int
    what: str
    ending: str


def write_originals(folder: Path) -> list[Original]:
    """All sound examples."""
    capture = small_capture()
    captures, scenes = write_captures(capture, folder / "captures"), write_scenes(folder / "scenes")
    result = write_result(capture, folder / "result", scenes["scene.ply"])
    found = [Original(n, "capture", path, path if path.is_dir() else path.parent) for n, path in captures.items()]
    found += [Original(name, "scene", path, path.parent) for name, path in scenes.items()]
    return [*found, Original("result", "result", result, result)]


def read(kind: Kind, path: Path) -> None:
    """Read all that there is."""
    if kind == "capture":
        open_capture(path)
    elif kind == "scene":
        load_any(path)
    else:
        scene_content("result", path / "scene.ply", read_scene(path / "scene.ply"), path, None).to_json()


def try_case(original: Original, rng: Random, work: Path) -> tuple[str, str]:
    """Break a copy and read it; returns what was broken, and the outcome."""
    copy = Path(shutil.copytree(original.folder, work / "copy"))
    try:
        files = sorted(path for path in copy.rglob("*") if path.is_file())
        # Most files of a capture are its photographs; what says how they belong together is more interesting.
        telling = [path for path in files if path.suffix not in (".png", ".jpg")] or files
        file = rng.choice(telling if rng.random() < 0.8 else files)
        what = f"{original.name}: {file.relative_to(copy).as_posix()}"
        if rng.random() < 0.08:
            break_tree(rng, copy, file)
        else:
            content = file.read_bytes()
            file.unlink()
            file.write_bytes(mutated(rng, file.name, content))
        try:
            read(original.kind, copy / original.path.relative_to(original.folder))
        except PocketGSError as error:
            length = len(str(error))
            return what, "refused" if 0 < length <= MAX_ERROR else f"refused with {length} characters"
        except BaseException:
            return what, "".join(traceback.format_exc())
        return what, "read"
    finally:
        shutil.rmtree(work / "copy", ignore_errors=True)


def work_through(originals: list[Original], seed: int, first: int, last: int, work: Path, told: Connection) -> None:
    """Run cases one by one, in a process that may hang or be killed."""
    work.mkdir(parents=True, exist_ok=True)
    for original in originals:  # what is loaded with the first of each kind is no case's
        read(original.kind, original.path)
    allowed = peak_rss_mb() + MAX_MB
    with memory_bound(BOUND_MB):
        for number in range(first, last):
            rng = Random(f"{seed} {number}")
            original = rng.choice(originals)
            told.send(number)
            what, ending = try_case(original, rng, work)
            if peak_rss_mb() > allowed:
                ending = f"took memory up to {peak_rss_mb():.0f} MB, expected at most {allowed:.0f} MB; {ending}"
                allowed = peak_rss_mb() + 50
            told.send(Outcome(number, what, ending))
    told.send(None)


def attack(folder: Path, cases: int, seed: int, first: int = 0, seconds: float = float("inf")) -> list[Outcome]:
    """Try cases until there are as many or time is over; those that hang or die are failures like others."""
    originals = write_originals(folder / "originals")
    outcomes: list[Outcome] = []
    ends, last = time.monotonic() + seconds, first + cases
    while first < last and time.monotonic() < ends:
        here, there = multiprocessing.Pipe(duplex=False)
        arguments = (originals, seed, first, last, folder / f"work {first}", there)
        process = multiprocessing.get_context("spawn").Process(target=work_through, args=arguments, daemon=True)
        process.start()
        there.close()
        ending, number, limit = "", first - 1, 10 * SECONDS_A_CASE
        while time.monotonic() < ends:
            try:
                if not here.poll(limit):
                    ending = f"took longer than {limit:.0f} s"
                    break
                message = here.recv()
            except EOFError:
                process.join()
                ending = f"ended the process with status {process.exitcode}"
                break
            limit = SECONDS_A_CASE
            if isinstance(message, Outcome):
                outcomes.append(message)
            elif message is None:
                break
            else:
                number = message
        process.kill()
        process.join()
        if number < first:
            raise RuntimeError(f"the sound examples cannot be read: {ending or 'no time was left'}")
        if ending:
            outcomes.append(Outcome(number, "", ending))
        first = number + 1 if ending else last
    return outcomes


def failures_of(outcomes: list[Outcome]) -> list[Outcome]:
    """Outcomes that are neither a result nor a refusal."""
    return [outcome for outcome in outcomes if outcome.ending not in ("read", "refused")]


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=sys.maxsize, help="how many cases to try")
    parser.add_argument("--seconds", type=float, default=None, help="how long to go on; 60 if no cases are given")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="the number of the first case")
    options = parser.parse_args()
    seconds = options.seconds or (60.0 if options.cases == sys.maxsize else float("inf"))
    with tempfile.TemporaryDirectory() as folder:
        outcomes = attack(Path(folder), options.cases, options.seed, options.first, seconds)
    failures = failures_of(outcomes)
    for failure in failures:
        print(f"case {failure.number}, {failure.what}\n{failure.ending}", file=sys.stderr)
    endings = Counter(outcome.ending for outcome in outcomes if outcome not in failures)
    print(f"{len(outcomes)} cases: {endings['read']} read, {endings['refused']} refused, {len(failures)} failures")
    return 1 if failures or not outcomes else 0


if __name__ == "__main__":
    os.environ.setdefault("NUMBA_NUM_THREADS", "1")
    sys.exit(main())
