"""Atomic file writes, after exceptions and after kills at random moments."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from pocketgs.errors import PocketGSError
from pocketgs.files.atomic_file import remove_leftovers, replacing

KILLED_WRITERS = """
import json, os, random, signal, sys, time
from pathlib import Path
from pocketgs.files.atomic_file import remove_leftovers, replacing

target = Path(sys.argv[1])
LENGTH = 1_000_000

def write(letter):
    with replacing(target) as partial, partial.open("wb") as file:
        for _ in range(20):
            file.write(letter * (LENGTH // 20))

write(b"a")
seen, leftovers = set(), 0
for round in range(60):
    child = os.fork()
    if child == 0:
        while True:
            write(b"b")
            write(b"c")
    time.sleep(random.uniform(0.0, 0.02))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    content = target.read_bytes()
    assert len(content) == LENGTH and len(set(content)) == 1, "torn"
    seen.add(content[:1].decode())
    leftovers += len(list(target.parent.iterdir())) - 1
    remove_leftovers(target)
    assert [path.name for path in target.parent.iterdir()] == [target.name], "not cleaned up"
print(json.dumps([sorted(seen), leftovers]))
"""


@pytest.mark.parametrize("part", ["a", "ä", "写", "🏠", "[1]"])
def test_names_as_long_as_the_file_system_takes(tmp_path: Path, part: str) -> None:
    """Those of temporary files are no longer, and still tell whose leftovers they are."""
    path = tmp_path / f"{part * (251 // len(part.encode()))}.jpg"
    with replacing(path) as partial:
        partial.write_bytes(b"new")
    assert path.read_bytes() == b"new"
    partial.touch()
    (tmp_path / "other.jpg").touch()
    remove_leftovers(path)
    assert sorted(item.name for item in tmp_path.iterdir()) == sorted([path.name, "other.jpg"])


def test_new_and_replaced(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    for content in ("one", "two"):
        with replacing(path) as partial:
            assert partial.parent == path.parent
            assert partial.suffix == ".txt"
            partial.write_text(content)
            assert not path.exists() or path.read_text() != content
        assert path.read_text() == content
    assert [item.name for item in tmp_path.iterdir()] == ["a.txt"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit, PocketGSError])
@pytest.mark.parametrize("existing", [False, True])
def test_exception_leaves_the_old_file(tmp_path: Path, error: type[BaseException], existing: bool) -> None:
    path = tmp_path / "a.txt"
    if existing:
        path.write_text("old")

    def write() -> None:
        with replacing(path) as partial:
            partial.write_text("half")
            raise error

    with pytest.raises(error):
        write()
    assert [item.name for item in tmp_path.iterdir()] == ["a.txt"] * existing
    assert not existing or path.read_text() == "old"


def test_disk_errors_are_ours(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("old")
    (tmp_path / "folder").mkdir()
    for path in (tmp_path / "none" / "a.txt", tmp_path / "file" / "a.txt", tmp_path / "folder"):
        with pytest.raises(PocketGSError, match="cannot be written"), replacing(path) as partial:
            partial.write_text("new")
    for path in (Path(), Path("/")):
        with pytest.raises(PocketGSError, match="is a folder"), replacing(path):
            pass
    assert sorted(item.name for item in tmp_path.iterdir()) == ["file", "folder"]
    assert (tmp_path / "file").read_text() == "old"


def test_nothing_written_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(PocketGSError, match=r"a\.txt: cannot be written"), replacing(tmp_path / "a.txt"):
        pass


def test_leftovers_of_other_files_stay(tmp_path: Path) -> None:
    others = [".a1.0123abcd.partial.txt", ".a[1].0123abcd.partial.ply", ".a[1].v2.0123abcd.partial.txt"]
    names = [".a[1].0123abcd.partial.txt", *others, "a[1].txt"]
    for name in names:
        (tmp_path / name).touch()
    remove_leftovers(tmp_path / "a[1].txt")
    assert sorted(item.name for item in tmp_path.iterdir()) == sorted(names[1:])


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_kill_at_any_moment(tmp_path: Path) -> None:
    command = [sys.executable, "-c", KILLED_WRITERS, str(tmp_path / "a.bin")]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert result.returncode == 0, result.stderr
    seen, leftovers = json.loads(result.stdout)
    # The kills must have met writers that had finished a file, and writers in the middle of one.
    assert {"b", "c"} <= set(seen)
    assert leftovers > 0
