"""Zip files that were made to do harm, or are just broken."""

from __future__ import annotations

import io
import os
import shutil
import stat
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pocketgs.errors import PocketGSError
from pocketgs.files.paths import without_here
from pocketgs.serve import shelf
from pocketgs.serve.archive import unpack
from zip_files import FROM_HERE, MEANT, NAMES, zip_of, zip_of_name

MB = 1_000_000


def unpacked(content: bytes, place: Path, max_bytes: int = MB) -> dict[str, bytes]:
    """Unpack, and check that only the folder has changed."""
    (place / "upload.zip").write_bytes(content)
    before = {path.name for path in place.parent.iterdir()}
    try:
        unpack(place / "upload.zip", place / "capture", max_bytes)
    finally:
        assert {path.name for path in place.parent.iterdir()} == before
        assert {path.name for path in place.iterdir()} <= {"upload.zip", "capture"}
    files = [path for path in (place / "capture").rglob("*") if path.is_file()]
    return {path.relative_to(place / "capture").as_posix(): path.read_bytes() for path in files}


def test_what_is_sound(tmp_path: Path) -> None:
    files = {"toys/transforms.json": b"{}", "toys/images/a b.png": b"\x89", "toys/ünïcode – 1.jpg": b"x", "-rf": b""}
    rubbish = {"__MACOSX/toys/._a": b"x", "toys/.DS_Store": b"x"}
    assert unpacked(zip_of(files | rubbish), tmp_path) == files


@pytest.mark.parametrize(
    "name",
    [
        "../out.txt",
        "toys/../../out.txt",
        "/etc/out.txt",
        "//server/share/out.txt",
        "C:/out.txt",
        "C:out.txt",
        "..\\out.txt",
        "toys\\..\\..\\out.txt",
        "\\\\server\\share\\out.txt",
        "C:\\out.txt",
        "toys/b\\a.txt",
        "toys/./a.txt",
        "toys//a.txt",
        ".//a.txt",
        "./../out.txt",
        "./.",
        "CON",
        "toys/nul.txt",
        "toys/Com1",
        "toys/LPT9.tar.gz",
        "AUX./a",
        "trailing. /a",
        "trailing.",
        "space ",
        "stream.txt:hidden",
        "question?",
        "bell\x07",
        "pipe|",
        "a" * 201,
        "é" * 101,
        "/".join("a" * 13),
    ],
)
def test_names_that_are_not_plain(tmp_path: Path, name: str) -> None:
    with pytest.raises(PocketGSError, match="expected names that every system can keep"):
        unpacked(zip_of({"a.txt": b"a", name: b"harm"}), tmp_path)
    assert not (tmp_path / "capture").exists(), "names are checked before anything is written"


@given(names=st.lists(st.text(st.sampled_from("ab./\\:~ \x01é"), min_size=1, max_size=8), max_size=5, unique=True))
def test_any_names_stay_inside(names: list[str], tmp_path_factory: pytest.TempPathFactory) -> None:
    place = tmp_path_factory.mktemp("upload") / "inner"
    place.mkdir()
    try:
        found = unpacked(zip_of(dict.fromkeys(names, b"x")), place)
    except PocketGSError:
        return
    if not any("/" in name for name in names):
        names = [name.replace("\\", "/") for name in names]
    assert set(found) == {without_here(name) for name in names if not name.endswith("/")}


def test_folders_separated_by_backslashes(tmp_path: Path) -> None:
    """As old programs on Windows do; the folders' own entries end with one too."""
    content = zip_of({"toys\\": b"", "toys\\images\\a.png": b"a", "toys\\transforms.json": b"{}"})
    assert unpacked(content, tmp_path) == {"toys/images/a.png": b"a", "toys/transforms.json": b"{}"}


@pytest.mark.parametrize(("written", "is_utf8", "meant"), NAMES)
def test_names_in_utf8_and_others(tmp_path: Path, written: bytes, is_utf8: bool, meant: str) -> None:
    assert unpacked(zip_of_name(written, is_utf8), tmp_path) == {meant: b"x"}


def test_names_that_begin_with_the_folder_itself(tmp_path: Path) -> None:
    assert unpacked(zip_of(FROM_HERE), tmp_path) == MEANT


@pytest.mark.skipif(os.name == "nt", reason="a folder with an open file cannot be moved there")
def test_a_folder_that_is_moved_meanwhile(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Such as to the trash: it is not made again where it was."""
    place = tmp_path / "place"
    place.mkdir()
    (place / "upload.zip").write_bytes(zip_of({"a.txt": b"a", "toys/b.txt": b"b"}))
    monkeypatch.setattr(shutil, "copyfileobj", lambda *_: place.rename(tmp_path / "trash"))
    with pytest.raises(FileNotFoundError):
        unpack(place / "upload.zip", place / "capture", MB)
    assert [path.name for path in tmp_path.iterdir()] == ["trash"]


def test_an_empty_name(tmp_path: Path) -> None:
    content = zip_of({"a": b"x"})
    with pytest.raises(PocketGSError, match="holds '', expected names"):
        unpacked(content.replace(b"a", b"\x00"), tmp_path)


def linked() -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        link = zipfile.ZipInfo("images")
        link.external_attr = (stat.S_IFLNK | 0o777) << 16
        archive.writestr(link, "/etc")
        archive.writestr("images/passwd", "harm")
    return content.getvalue()


def encrypted() -> bytes:
    content = bytearray(zip_of({"a.txt": b"a"}))
    for mark, flags in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        content[content.index(mark) + flags] |= 1
    return bytes(content)


def damaged() -> bytes:
    content = bytearray(zip_of({"a.txt": b"abcdefgh" * 100}))
    content[len("PK") + 40] ^= 0xFF
    return bytes(content)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (linked, "'images', which is a link or a device"),
        (encrypted, "is encrypted"),
        (damaged, "is no whole zip file"),
        (lambda: zip_of({"a.txt": b"a"})[:-10], "is no whole zip file"),
        (lambda: b"", "is no whole zip file"),
        (lambda: zip_of_name(b"\xff", is_utf8=True), "is no whole zip file"),
        (lambda: b"PK" + bytes(1000), "is no whole zip file"),
        (lambda: zip_of({"bomb.bin": bytes(2 * MB)}), "unpacks to 2 MB, expected at most 1 MB"),
        (lambda: zip_of({f"{i}.bin": bytes(MB // 10) for i in range(11)}), "unpacks to 1 MB"),
        (lambda: zip_of({"a.JPG": b"a", "A.jpg": b"b"}), "holds 'A.jpg' twice"),
        (lambda: zip_of({"e\u0301": b"a", "\u00e9": b"b"}), "twice"),
        (lambda: zip_of({"a": b"a", "a/b": b"b"}), "a file and a folder of the same name"),
        (lambda: zip_of({"a": b"a"}, zipfile.ZIP_LZMA), "'a', compressed by method 14: expected files that are stored"),
    ],
)
def test_what_is_refused(tmp_path: Path, make: Callable[[], bytes], sentence: str) -> None:
    with pytest.raises(PocketGSError, match=sentence):
        unpacked(make(), tmp_path)


def test_disk_without_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shelf, "RESERVE", 1 << 60)
    with pytest.raises(PocketGSError, match="unpacks to 1 MB, and the disk has room for 0 MB"):
        unpacked(zip_of({"large.bin": bytes(MB)}), tmp_path)
    assert not (tmp_path / "capture").exists()


def test_sizes_that_lie(tmp_path: Path) -> None:
    """The archive states 10 bytes where there are a million: no more than these are written."""
    content = bytearray(zip_of({"bomb.bin": bytes(MB)}))
    for mark, size in ((b"PK\x03\x04", 22), (b"PK\x01\x02", 24)):
        at = content.index(mark) + size
        content[at : at + 4] = (10).to_bytes(4, "little")
    with pytest.raises(PocketGSError, match="is no whole zip file"):
        unpacked(bytes(content), tmp_path, 1000)
    assert (tmp_path / "capture" / "bomb.bin").stat().st_size <= 10
