"""A folder has one writer at a time, who does not touch other programs' files."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from pocketgs.errors import PocketGSError
from pocketgs.files.lock import InUseError, locked
from pocketgs.files.manifest import read_manifest, source_of
from pocketgs.results.claim import claimed
from pocketgs.results.folder import check_free_for, claimed_for_run, publishing

HOLDER = """
import sys, time
from pathlib import Path
from pocketgs.files.lock import locked
with locked(Path(sys.argv[1]), Path("there")):
    print("held", flush=True)
    time.sleep(600)
"""


def write(folder: Path, *names: str, content: bytes = b"ours") -> None:
    with publishing(folder, names) as staging:
        for name in names:
            (staging / name).parent.mkdir(exist_ok=True)
            (staging / name).write_bytes(content)


def test_the_lock_dies_with_its_process(tmp_path: Path) -> None:
    lock = tmp_path / "lock"
    holder = subprocess.Popen([sys.executable, "-c", HOLDER, str(lock)], stdout=subprocess.PIPE, text=True)
    with holder:
        assert holder.stdout
        assert holder.stdout.readline() == "held\n"
        with (
            pytest.raises(InUseError, match=r"^there: another pocketgs process is writing there"),
            locked(lock, Path("there")),
        ):
            pass
        holder.kill()
    assert lock.exists()
    with locked(lock, Path("there")):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_second_writer_is_refused_and_changes_nothing(
    tmp_path: Path, contents: Callable[[Path], dict[str, bytes]]
) -> None:
    with claimed(tmp_path / "result") as claim, claim.publishing() as staging:
        (staging / "scene.ply").write_bytes(b"first")
        before = contents(tmp_path)
        with pytest.raises(InUseError, match="another pocketgs process is writing there"):
            write(tmp_path / "result", "scene.ply")
        assert contents(tmp_path) == before
    assert (tmp_path / "result" / "scene.ply").read_bytes() == b"first"


def test_a_staging_folder_that_vanishes_is_an_error(tmp_path: Path) -> None:
    def publish(remove: str) -> None:
        with claimed(tmp_path) as claim, claim.publishing(["scene.ply"]) as staging:
            (staging / "scene.ply").write_bytes(b"new")
            (staging / "run.json").write_bytes(b"new")
            (staging / remove).unlink()
            if remove == "run.json":
                (staging / "scene.ply").unlink()
                staging.rmdir()

    for remove in ("scene.ply", "run.json"):
        with pytest.raises(PocketGSError, match=r"scene\.ply: was written but is missing"):
            publish(remove)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("foreign", ["scene.ply", "cameras.json", "checkpoint.npz", "run.json", "held_out/a.png"])
def test_somebody_elses_files_are_refused_before_the_work(tmp_path: Path, foreign: str) -> None:
    path = tmp_path / foreign
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(b"mine")
    with pytest.raises(PocketGSError, match=f"{path.name}: was not written by pocketgs"), claimed_for_run(tmp_path):
        pytest.fail("the work began")
    assert path.read_bytes() == b"mine"
    assert not (tmp_path / ".pocketgs").exists()


def test_unfinished_of_somebody_else(tmp_path: Path) -> None:
    (tmp_path / "unfinished.npz").write_bytes(b"mine")
    with pytest.raises(PocketGSError, match=r"unfinished\.npz: is not a checkpoint of ours"), claimed_for_run(tmp_path):
        pytest.fail("the work began")


def test_files_that_have_been_changed_are_refused(tmp_path: Path) -> None:
    write(tmp_path, "scene.ply")
    write(tmp_path, "scene.ply")
    (tmp_path / "scene.ply").write_bytes(b"edited")
    with pytest.raises(PocketGSError, match=r"scene\.ply: has been changed since pocketgs wrote it"):
        write(tmp_path, "scene.ply")
    assert (tmp_path / "scene.ply").read_bytes() == b"edited"


def test_a_file_that_appears_during_the_work_stays_and_the_result_is_kept(tmp_path: Path) -> None:
    def publish() -> None:
        with publishing(tmp_path) as staging:
            (staging / "scene.ply").write_bytes(b"ours")
            (tmp_path / "scene.ply").write_bytes(b"mine")

    with pytest.raises(PocketGSError, match=r"was not written by pocketgs.*the new result is in .*unpublished-"):
        publish()
    (kept,) = tmp_path.glob("unpublished-*")
    assert (kept / "scene.ply").read_bytes() == b"ours"
    assert (tmp_path / "scene.ply").read_bytes() == b"mine"


@pytest.mark.skipif(sys.platform == "win32", reason="links need rights there")
def test_links_are_nobodys(tmp_path: Path) -> None:
    outside = tmp_path / "outside"
    outside.mkdir()
    write(tmp_path / "result", "scene.ply", "held_out/a.png")
    for name in ("scene.ply", "held_out/a.png"):
        (tmp_path / "result" / name).rename(outside / Path(name).name)
    (tmp_path / "result" / "scene.ply").symlink_to(outside / "scene.ply")
    with pytest.raises(PocketGSError, match=r"scene\.ply: was not written by pocketgs"):
        write(tmp_path / "result", "scene.ply")
    (tmp_path / "result" / "held_out").rmdir()
    (tmp_path / "result" / "held_out").symlink_to(outside)
    with pytest.raises(PocketGSError, match="held_out: is not a folder that pocketgs made"):
        write(tmp_path / "result", "held_out/a.png")
    assert sorted(os.listdir(outside)) == ["a.png", "scene.ply"]


def test_other_files_stay(tmp_path: Path, contents: Callable[[Path], dict[str, bytes]]) -> None:
    write(tmp_path, "held_out/a.png", "scene.ply")
    (tmp_path / "held_out" / "notes.txt").write_bytes(b"mine")
    (tmp_path / "notes.txt").write_bytes(b"mine")
    with claimed_for_run(tmp_path) as claim, claim.publishing(outdated=["held_out/*"]) as staging:
        (staging / "scene.ply").write_bytes(b"new")
    found = contents(tmp_path)
    found.pop(".pocketgs/manifest.json")
    assert found == {"held_out/notes.txt": b"mine", "notes.txt": b"mine", "scene.ply": b"new"}


def test_a_capture_is_no_output_folder(capture_folder: Path, contents: Callable[[Path], dict[str, bytes]]) -> None:
    before = contents(capture_folder)
    photographs = capture_folder / "images"
    for folder in (capture_folder, photographs):
        with pytest.raises(PocketGSError, match="holds a capture"), claimed(folder):
            pytest.fail("the work began")
    assert contents(capture_folder) == before


def test_pictures_of_ours_are_no_capture(tmp_path: Path) -> None:
    for _ in range(2):
        write(tmp_path, "0000.png", "0001.png")


def test_captures_of_one_name(tmp_path: Path) -> None:
    one, other = source_of(tmp_path / "one" / "fern"), source_of(tmp_path / "other" / "fern")
    folder = tmp_path / "output"
    check_free_for(folder, one)
    with claimed_for_run(folder, one) as claim, claim.publishing() as staging:
        (staging / "scene.ply").write_bytes(b"one")
    check_free_for(folder, one)
    with pytest.raises(PocketGSError, match="holds the result of another capture of this name"):
        check_free_for(folder, other)
    write(folder, "0000.png")
    assert read_manifest(folder).source == one
    assert str(tmp_path) not in (folder / ".pocketgs" / "manifest.json").read_text()


@pytest.mark.parametrize(
    "broken", ["", "{", "[]", '{"files": 3, "source": null}', '{"files": {"../x": "0"}, "source": 1}', "[" * 100_000]
)
def test_a_broken_manifest_owns_nothing(tmp_path: Path, broken: str) -> None:
    write(tmp_path, "scene.ply")
    (tmp_path / ".pocketgs" / "manifest.json").write_text(broken)
    assert read_manifest(tmp_path).files == {}
    with pytest.raises(PocketGSError, match=r"scene\.ply: was not written by pocketgs"):
        write(tmp_path, "scene.ply")
