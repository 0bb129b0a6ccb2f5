"""An attack on what is published: errors and kills at every file operation, at random times, and two at a time.

    python tests/attack/publishing.py --seconds 60

goes on for as long as it is told to, at least through every file operation once, and prints what it has tried and what
has failed; the exit status is 1 if anything has. It needs a system with `fork`.
"""

from __future__ import annotations

import argparse
import errno
import os
import random
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Literal
from unittest.mock import patch

from pocketgs.errors import PocketGSError
from pocketgs.files.journal import PENDING, settle
from pocketgs.files.lock import InUseError
from pocketgs.files.manifest import read_manifest
from pocketgs.results.claim import claimed

Trouble = Literal["none", "error", "errors from then on", "kill"]
TROUBLES: tuple[Trouble, ...] = ("error", "errors from then on", "kill")

DONE, REFUSED, BROKEN = 0, 2, 70
"""Exit statuses of a process that has published, has reported an error, or has failed in a forbidden way."""

# What Python reports to audit hooks before it does it; `os.remove` stands for unlink, and `os.rename` for replace.
OPERATIONS = frozenset(
    ["open", "os.rename", "os.mkdir", "os.rmdir", "os.remove", "os.listdir", "os.scandir", "fcntl.flock"]
)
FOREIGN = {"notes.txt": b"mine", "held_out/notes.txt": b"mine too", "other/0000.png": b"and mine"}


def content_of(version: int) -> dict[str, bytes]:
    """The files of a version: some that all have, and pictures that only some have."""
    written = str(version).encode() * 5000
    files = {"scene.ply": written, "run.json": written, "cameras.json": written, "checkpoint.npz": written}
    return {**files, **{f"held_out/{number:04d}.png": written for number in range(version % 3)}}


def publish(folder: Path, version: int) -> None:
    """Publish a version as a run does."""
    names = ("scene.ply", "run.json", "cameras.json", "checkpoint.npz", "held_out/*.png")
    with claimed(folder, names) as claim, claim.publishing(names[:4], outdated=["held_out/*"]) as staging:
        for name, content in content_of(version).items():
            (staging / name).parent.mkdir(exist_ok=True)
            (staging / name).write_bytes(content)


def version_in(folder: Path) -> int:
    """The version that the next reader finds in a folder.

    Raises:
        AssertionError: it is a mixture, or something that nobody of ours has written has changed.
    """
    settle(folder)
    found = {name: (folder / name).read_bytes() for name in read_manifest(folder).files}
    version = int(found["run.json"][:1])
    assert found == content_of(version), f"a mixture of versions: { {name: text[:1] for name, text in found.items()} }"
    pictures = {path.relative_to(folder).as_posix() for path in (folder / "held_out").glob("*.png")}
    assert pictures == {name for name in found if name.endswith(".png")}, f"pictures of another version: {pictures}"
    for name, content in FOREIGN.items():
        assert (folder / name).read_bytes() == content, f"{name} of somebody else has changed"
    for kept in folder.glob("unpublished-*"):
        whole = {name: (kept / name).read_bytes() for name in content_of(int((kept / "run.json").read_bytes()[:1]))}
        assert len(set(map(bytes.__len__, whole.values()))) == 1, "half a result was kept"
    assert not (folder / PENDING).exists()
    return version


def prepare(folder: Path) -> None:
    """A folder with version 2 and other programs' files."""
    for name, content in FOREIGN.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    publish(folder, 2)


class FileOperations:
    """Counts this process's file operations in a folder, and disturbs one of them."""

    def __init__(self, folder: Path, at: int, trouble: Trouble) -> None:
        self.count = 0
        self._folder, self._at, self._trouble = str(folder), at, trouble
        sys.addaudithook(self._observe)

    def _observe(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event not in OPERATIONS:
            return
        path = arguments[0]
        if isinstance(path, str | Path) and os.path.isabs(path) and not str(path).startswith(self._folder):
            return  # such as a module that is imported
        number = self.count
        self.count += 1
        if self._trouble == "kill" and number == self._at:
            os.kill(os.getpid(), signal.SIGKILL)
        if (self._trouble == "error" and number == self._at) or (
            self._trouble == "errors from then on" and number >= self._at
        ):
            raise OSError(errno.EIO, "an injected error", str(path))


def in_a_child(work: Callable[[], None]) -> int:
    """Start some work in another process; its number."""
    child = os.fork()
    if child:
        return child
    status = BROKEN
    try:
        work()
        status = DONE
    except PocketGSError:
        status = REFUSED
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(status)


def outcome_of(child: int) -> int:
    """Wait for a process: how it has ended, negative if by a signal."""
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def disturbed(folder: Path, work: Callable[[], None], at: int, trouble: Trouble) -> int:
    """Do some work in another process with a fault at one of its file operations; returns its exit status."""

    def act() -> None:
        FileOperations(folder, at, trouble)
        work()

    return outcome_of(in_a_child(act))


def operations_of(folder: Path, work: Callable[[], None]) -> int:
    """Number of file operations that some work takes in a folder."""
    reading, writing = os.pipe()

    def act() -> None:
        operations = FileOperations(folder, 0, "none")
        work()
        os.write(writing, str(operations.count).encode())

    assert outcome_of(in_a_child(act)) == DONE
    os.close(writing)
    with os.fdopen(reading) as said:
        return int(said.read())


@contextmanager
def prepared() -> Iterator[Path]:
    """A folder with version 2, for as long as the block takes; no power cut is tried, so nothing waits for the disk."""
    with tempfile.TemporaryDirectory() as name, patch("os.fsync"):
        folder = Path(name).resolve() / "result"
        prepare(folder)
        yield folder


def attack_operation(at: int, trouble: Trouble, again_at: int | None = None) -> None:
    """Disturb the publishing of version 3 at one operation, and perhaps its completion by the next reader at another.

    Raises:
        AssertionError: what is found afterwards is neither the old nor the new version, or no further one can follow.
    """
    with prepared() as folder:
        ended = disturbed(folder, lambda: publish(folder, 3), at, trouble)
        assert ended in (DONE, REFUSED, -signal.SIGKILL), f"the command ended with {ended}"
        if again_at is not None:
            again = disturbed(folder, lambda: settle(folder), again_at, trouble)
            assert again in (DONE, REFUSED, -signal.SIGKILL), f"the next reader ended with {again}"
        try:
            version = version_in(folder)
        except PocketGSError:  # a reader that had to take the new result back says so, once
            version = version_in(folder)
        assert version == 3 if ended == DONE else version in (2, 3), f"version {version} after the command said {ended}"
        publish(folder, 4)
        assert version_in(folder) == 4


def attack_moment(seconds: float) -> None:
    """Kill a process that publishes again and again after some time.

    Raises:
        AssertionError: as `attack_operation`.
    """
    with prepared() as folder:
        child = in_a_child(lambda: _publish_for_ever(folder))
        time.sleep(seconds)
        os.kill(child, signal.SIGKILL)
        assert outcome_of(child) == -signal.SIGKILL
        assert version_in(folder) in range(2, 9)
        publish(folder, 1)
        assert version_in(folder) == 1


def _publish_for_ever(folder: Path) -> None:
    while True:
        for version in range(3, 9):
            publish(folder, version)


def attack_by_two(rounds: int, killed: bool) -> Counter[str]:
    """Let two processes publish into one folder at random times, and perhaps kill one of them.

    Returns:
        How often they have published, and how often one has been refused.

    Raises:
        AssertionError: one has failed in another way than by saying that the folder is in use, or as above.
    """
    seen: Counter[str] = Counter()
    names = {DONE: "published", REFUSED: "refused", -signal.SIGKILL: "killed"}
    with prepared() as folder:
        for _ in range(rounds):
            children = {version: in_a_child(partial(_publish_soon, folder, version)) for version in (5, 7)}
            if killed:
                time.sleep(random.uniform(0, 0.02))
                os.kill(random.choice(list(children.values())), signal.SIGKILL)
            ends = {version: outcome_of(child) for version, child in children.items()}
            assert set(ends.values()) <= set(names), f"ended with {ends}"
            seen.update(names[end] for end in ends.values())
            found = version_in(folder)
            if not killed:
                assert found in [version for version, end in ends.items() if end == DONE], f"{found} after {ends}"
    return seen


def _publish_soon(folder: Path, version: int) -> None:
    random.seed()
    time.sleep(random.uniform(0, 0.01))
    try:
        publish(folder, version)
    except InUseError:
        raise
    except PocketGSError as error:
        raise AssertionError(f"refused for another reason than the other process: {error}") from error


class Attacks:
    """Counts of attempts and failures."""

    def __init__(self) -> None:
        self.tried: Counter[str] = Counter()
        self.failures: list[str] = []

    def attempt(self, kind: str, attack: Callable[..., object], *arguments: object) -> None:
        """Run one attack."""
        self.tried[kind] += 1
        try:
            found = attack(*arguments)
        except Exception as error:
            self.failures.append(f"{kind} {arguments}: {error}")
            print("failed:", self.failures[-1], file=sys.stderr)
        else:
            if isinstance(found, Counter):
                self.tried.update(found)


def attack_for(seconds: float) -> Attacks:
    """Make every attack on a single operation, and then others at random until the time is up."""
    end, attacks = time.monotonic() + seconds, Attacks()
    with prepared() as folder:
        count = operations_of(folder, lambda: publish(folder, 3))
    for trouble in TROUBLES:
        for at in range(count):
            attacks.attempt(f"{trouble} at an operation", attack_operation, at, trouble)
    while time.monotonic() < end:
        trouble = random.choice(TROUBLES)
        attacks.attempt(f"{trouble} twice", attack_operation, random.randrange(count), trouble, random.randrange(count))
        attacks.attempt("kill at a random moment", attack_moment, random.uniform(0, 0.05))
        attacks.attempt("two processes", attack_by_two, 2, False)
        attacks.attempt("two processes, one killed", attack_by_two, 2, True)
    return attacks


def main() -> None:
    parser = argparse.ArgumentParser(description="Attack what is published.")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=None)
    arguments = parser.parse_args()
    random.seed(arguments.seed)
    attacks = attack_for(arguments.seconds)
    for kind, number in sorted(attacks.tried.items()):
        print(f"{number:7,} {kind}")
    print(f"{len(attacks.failures)} failures")
    sys.exit(bool(attacks.failures))


if __name__ == "__main__":
    main()
