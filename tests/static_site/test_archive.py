"""Zip files: whole ones are read, and everything else ends in one sentence."""

from __future__ import annotations

import base64
import io
import struct
import zipfile
import zlib
from collections.abc import Callable, Mapping
from typing import Any

import pytest
from playwright.sync_api import Error

from zip_files import FROM_HERE, MEANT, NAMES, zip_of, zip_of_name

Call = Callable[..., Any]

READ = """
    const {FileTree} = await import(new URL("archive/tree.js", location.href));
    const bytes = Uint8Array.from(atob(given), (character) => character.charCodeAt(0));
    const tree = new FileTree(await module.filesInZip(new Blob([bytes]), "capture.zip"));
    const found = {};
    for (const path of tree.paths) {
        found[path] = [...await tree.find(path).bytes()];
    }
    return found;
"""

CONTENTS = {"a/transforms.json": b"{}" * 1000, "a/images/ä.png": bytes(range(256)) * 40, "empty": b""}


def read(call: Call, archive: bytes) -> dict[str, bytes]:
    found = call("archive/zip.js", READ, base64.b64encode(archive).decode())
    return {path: bytes(content) for path, content in found.items()}


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_whole_archives(call: Call, method: int) -> None:
    assert read(call, zip_of(CONTENTS, method)) == CONTENTS


def test_with_a_comment_and_what_systems_add(call: Call) -> None:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.comment = b"PK\x05\x06 what a comment"
        archive.mkdir("a") if hasattr(archive, "mkdir") else archive.writestr("a/", b"")
        archive.writestr("a/b", b"c")
        archive.writestr("__MACOSX/a/._b", b"d")
        archive.writestr("a/.DS_Store", b"e")
    assert read(call, stream.getvalue()) == {"a/b": b"c"}


def test_with_bytes_in_front(call: Call) -> None:
    """As in archives that unpack themselves."""
    assert read(call, b"MZ" + bytes(999) + zip_of(CONTENTS)) == CONTENTS


def test_with_bytes_before_the_end(call: Call) -> None:
    """As `zip` writes a record of 64 bits that nobody needs."""
    archive = zip_of(CONTENTS)
    assert read(call, archive[:-22] + bytes(76) + archive[-22:]) == CONTENTS


def test_with_the_backslashes_of_old_tools(call: Call) -> None:
    archive = zip_of({"a\\": b"", "a\\transforms.json": b"{}", "a\\images\\b.png": b"b"})
    assert read(call, archive) == {"a/transforms.json": b"{}", "a/images/b.png": b"b"}


@pytest.mark.parametrize(("written", "is_utf8", "meant"), NAMES)
def test_names_in_utf8_and_others(call: Call, written: bytes, is_utf8: bool, meant: str) -> None:
    """As `pocketgs serve` reads them."""
    assert read(call, zip_of_name(written, is_utf8)) == {meant: b"x"}


def test_names_that_begin_with_the_folder_itself(call: Call) -> None:
    assert read(call, zip_of(FROM_HERE)) == MEANT


def wide_zip_of(files: Mapping[str, bytes], before: int = 0) -> bytes:
    """An archive of stored files whose numbers all have 64 bits.

    Args:
        files: contents by their names.
        before: so many bytes, which are not there, are counted too.
    """
    content, listed = b"", b""
    for name, data in files.items():
        fields = struct.pack("<HHHHHI", 45, 1 << 11, 0, 0, 33, zlib.crc32(data))
        another = struct.pack("<HHI", 0x7777, 4, 0)
        extra = another + struct.pack("<HHQQQ", 1, 24, len(data), len(data), before + len(content))
        listed += struct.pack("<IH", 0x02014B50, 45) + fields + b"\xff" * 8
        listed += struct.pack("<HH", len(name.encode()), len(extra)) + bytes(10) + b"\xff" * 4 + name.encode() + extra
        content += struct.pack("<I", 0x04034B50) + fields + struct.pack("<II", len(data), len(data))
        content += struct.pack("<HH", len(name.encode()), 0) + name.encode() + data
    numbers = (44, 45, 45, 0, 0, len(files), len(files), len(listed), before + len(content))
    record = struct.pack("<IQHHIIQQQQ", 0x06064B50, *numbers)
    locator = struct.pack("<IIQI", 0x07064B50, 0, before + len(content) + len(listed), 1)
    return content + listed + record + locator + struct.pack("<IHH", 0x06054B50, 0, 0) + b"\xff" * 12 + bytes(2)


def test_numbers_of_64_bits(call: Call) -> None:
    """As `zip` writes them when it does not know sizes beforehand, and as any program does beyond 4 GB."""
    archive = wide_zip_of(CONTENTS)
    with zipfile.ZipFile(io.BytesIO(archive)) as opened:
        assert {name: opened.read(name) for name in opened.namelist()} == CONTENTS
    assert read(call, archive) == CONTENTS


def test_an_archive_of_more_than_4_gb(call: Call) -> None:
    script = """
        const whole = new Blob([Uint8Array.from(atob(given.archive), (character) => character.charCodeAt(0))]);
        const slice = (start, end) => {
            const missing = new Uint8Array(Math.max(0, given.before - start));
            return new Blob([missing, whole.slice(Math.max(0, start - given.before), end - given.before)]);
        };
        const files = await module.filesInZip({size: given.before + whole.size, slice}, "capture.zip");
        return Promise.all(files.map(async (file) => [file.path, [...await file.bytes()]]));
    """
    before = 5_000_000_000
    archive = base64.b64encode(wide_zip_of(CONTENTS, before)).decode()
    found = call("archive/zip.js", script, {"archive": archive, "before": before})
    assert {path: bytes(content) for path, content in found} == CONTENTS


def stating(archive: bytes, offset: int, value: int) -> bytes:
    """With another number in the first entry of the list of files."""
    at = archive.index(b"PK\x01\x02") + offset
    return archive[:at] + struct.pack("<I", value) + archive[at + 4 :]


def stating_wide(place: int, value: int) -> bytes:
    """With another number of 64 bits in the entry."""
    at = WIDE.index(struct.pack("<HH", 1, 24)) + 4 + place
    return WIDE[:at] + struct.pack("<Q", value) + WIDE[at + 8 :]


def damaged(archive: bytes) -> bytes:
    return archive[:60] + bytes([archive[60] ^ 255]) + archive[61:]


WIDE = wide_zip_of({"a.json": b"{}"})
WHOLE = zip_of({"a.json": b'{"some": "text"}' * 50}, zipfile.ZIP_STORED)
BOMB = zip_of({"a.json": bytes(3_000_000)})


@pytest.mark.parametrize(
    ("archive", "words"),
    [
        (b"", "no zip file, or cut short"),
        (b"not a zip file at all" * 100, "no zip file, or cut short"),
        (WHOLE[: len(WHOLE) // 2], "no zip file, or cut short"),
        (WHOLE[:-30], "no zip file, or cut short"),
        (WHOLE[100:], "its list of files is broken|is not where"),
        (damaged(WHOLE), "a.json is damaged"),
        (damaged(zip_of(CONTENTS)), "is damaged"),
        (stating(BOMB, 24, 2_000_000_000), "would take 2000 MB: expected at most 512 MB"),
        (stating(BOMB, 24, 100), "a.json is damaged"),
        (stating(BOMB, 24, 4_000_000), "a.json is damaged"),
        (stating(WHOLE, 42, 5_000_000), "a.json is not where its list of files says"),
        (stating(WHOLE, 8, 1), "encrypted"),
        (WIDE[:-43] + b"x" + WIDE[-42:], "its list of files is broken"),
        (WIDE.replace(b"PK\x06\x06", b"PK\x06\x05"), "its list of files is broken"),
        (WIDE.replace(b"PK\x06\x07", b"PK\x06\x05"), "its list of files is broken"),
        (wide_zip_of({"a.json": b"{}"}, 1 << 63), "its list of files is broken"),
        (WIDE[-42:], "its list of files is broken"),
        (WIDE[-22:], "its list of files is broken"),
        (stating_wide(0, 1 << 63), "would take 9223372036855 MB: expected at most 512 MB"),
        (stating_wide(8, 1 << 63), "a.json is damaged"),
        (stating_wide(16, 1 << 63), "a.json is not where its list of files says"),
        (zip_of({str(i): b"" for i in range(50_001)}), "holds 50001 files: expected at most 50000"),
        (zip_of_name(b"\xff", is_utf8=True), "expected names in UTF-8 where it says so"),
        (zip_of({"a.json": b"text" * 100}, zipfile.ZIP_BZIP2), "compressed by method 12"),
        (zip_of({"../a.json": b"{}"}), "leads out of its folder"),
        (zip_of({"a/../../b": b"{}"}), "leads out of its folder"),
        (zip_of({"/etc/passwd": b"{}"}), "leads out of its folder"),
        (zip_of({".//etc/passwd": b"{}"}), "leads out of its folder"),
        (zip_of({"./../a.json": b"{}"}), "leads out of its folder"),
        (zip_of({"a\\b": b"{}", "a/c": b"{}"}), "leads out of its folder"),
        (zip_of({"a\\..\\..\\b": b"{}"}), "leads out of its folder"),
        (zip_of({"\\b": b"{}"}), "leads out of its folder"),
        (zip_of({"C:\\b": b"{}"}), "leads out of its folder"),
        (zip_of({"C:/b": b"{}"}), "leads out of its folder"),
    ],
)
def test_what_is_no_sound_archive(call: Call, archive: bytes, words: str) -> None:
    with pytest.raises(Error, match=words):
        read(call, archive)


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_the_same_path_twice(call: Call) -> None:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("a", b"1")
        archive.writestr("a", b"2")
    with pytest.raises(Error, match="the file a is there twice"):
        read(call, stream.getvalue())


def test_cut_anywhere_or_with_any_byte_changed(call: Call) -> None:
    """An archive or file that does not unpack to its content is refused, with an error that names it."""
    script = f"""
        const {{FileTree}} = await import(new URL("archive/tree.js", location.href));
        const whole = Uint8Array.from(atob(given), (character) => character.charCodeAt(0));
        const outcome = async (bytes) => {{
            const given = btoa(String.fromCharCode(...bytes));
            try {{
                return JSON.stringify(await (async () => {{ {READ} }})());
            }} catch (error) {{
                return error.message;
            }}
        }};
        const outcomes = [];
        for (let i = 0; i < whole.length; i++) {{
            const changed = whole.slice();
            changed[i] ^= 0x5a;
            outcomes.push(await outcome(changed), await outcome(whole.subarray(0, i)));
        }}
        return [await outcome(whole), outcomes];
    """
    archive = zip_of({"a.json": b"some text, some text", "b": b"x"})
    whole, outcomes = call("archive/zip.js", script, base64.b64encode(archive).decode())
    assert whole.startswith('{"a.json"')
    for outcome in outcomes:
        assert outcome == whole or outcome.startswith(("capture.zip: ", "the file ", "{")), outcome
        if outcome.startswith("{"):  # names and fields that nobody reads may have changed, contents may not
            assert str(list(b"some text, some text")).replace(" ", "") in outcome or "a.json" not in outcome


AWAY = "cannot be read any more: the system may have moved it, such as to the cloud; choose it once more"
TOO_LARGE = "does not fit into the browser's memory: close other tabs, or choose a smaller capture"


@pytest.mark.parametrize(("error", "sentence"), [("NotReadableError", AWAY), ("RangeError", TOO_LARGE)])
def test_what_cannot_be_read_is_not_called_damaged(call: Call, error: str, sentence: str) -> None:
    """Systems take files back, such as to the cloud; and memory may be full."""
    script = """
        const {StoredFile} = await import(new URL("archive/tree.js", location.href));
        const {decoded} = await import(new URL("capture/pixels.js", location.href));
        const whole = new Blob([Uint8Array.from(atob(given.archive), (character) => character.charCodeAt(0))]);
        const fail = () => {
            throw given.error === "RangeError" ? new RangeError("full") : new DOMException("", given.error);
        };
        let failing = "";
        const slice = (...range) => ({
            arrayBuffer: async () => (failing === "list" ? fail() : whole.slice(...range).arrayBuffer()),
            stream: () => (failing === "content" ? new ReadableStream({pull: fail}) : whole.slice(...range).stream()),
        });
        const archive = {size: whole.size, slice};
        const told = (work) => work.then(() => "read", ({message}) => message);
        const [file] = await module.filesInZip(archive, "scan.zip");
        failing = "content";
        const outcomes = [await told(file.bytes()), await told(file.start(9))];
        failing = "list";
        const fromDisk = StoredFile.ofDisk(archive, "a.json").bytes();
        outcomes.push(await told(module.filesInZip(archive, "scan.zip")), await told(fromDisk));
        const decode = self.createImageBitmap;
        self.createImageBitmap = async () => fail();
        outcomes.push(await told(decoded(new Uint8Array(9), "image/png", "a.png")));
        self.createImageBitmap = decode;
        return outcomes;
    """
    given = {"archive": base64.b64encode(zip_of({"a.json": b"text"})).decode(), "error": error}
    assert call("archive/zip.js", script, given) == [
        f"scan.zip: a.json {sentence}",
        f"scan.zip: a.json {sentence}",
        f"scan.zip: {sentence}",
        f"a.json {sentence}",
        f"a.png {sentence}",
    ]
