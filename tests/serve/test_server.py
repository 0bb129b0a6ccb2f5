"""Uploads that the server accepts and refuses. Nothing is trained here."""

from __future__ import annotations

import errno
import http.client
import io
import json
import os
import re
import shutil
import socket
import threading
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlsplit

import numpy as np
import pytest
from PIL import Image

from files.test_full_disk import files_of_at_most
from pocketgs.results.checkpoint import CHECKPOINT, UNFINISHED
from pocketgs.results.folder import SCENE
from pocketgs.results.video import write_video
from pocketgs.scene.formats import read_scene, write_scene
from pocketgs.scene.gaussians import Gaussians
from pocketgs.serve import downloads, pieces, shelf, uploads
from pocketgs.serve.pieces import MAX_PIECE
from pocketgs.serve.server import ServeOptions, serving_folder
from serve.client import Phone
from serve.conftest import jpeg, left_behind
from viewer.client import fetch, origin_of
from zip_files import zip_of

pytestmark = pytest.mark.usefixtures("untrained")
Serve = Callable[..., Phone]
VIDEO = {"walk.mov": bytes(range(256)) * 8}
NO_ROOM = "the computer's disk is full (nothing was changed): delete something there, or empty the trash, and try again"


def below(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*")}


def test_photographs_arrive(serve: Serve, folder: Path, photographs: dict[str, bytes]) -> None:
    phone = serve()
    identity = phone.upload(photographs, title="  Living\troom ")
    told = phone.until(identity, "queued")
    assert (told["title"], told["kind"], told["count"], told["place"]) == ("Living room", "photographs", 8, 1)
    # Numbered in the order of the names' numbers, under names of the server's own.
    upload = folder / "captures" / identity / "upload"
    for number, name in enumerate([f"IMG_{i}.JPG" for i in range(5, 13)], start=1):
        assert (upload / f"{number:04d}.jpg").read_bytes() == photographs[name]
    answer = fetch(phone.url, f"captures/{identity}/thumbnail.jpg")
    assert answer.headers["Content-Type"] == "image/jpeg"
    assert Image.open(io.BytesIO(answer.body)).size == (96, 72)


def test_a_video_and_archives_arrive(serve: Serve, folder: Path, zipped: bytes, tmp_path: Path) -> None:
    phone = serve()
    frames = [np.full((48, 64, 3), 20 * number, np.uint8) for number in range(5)]
    write_video(tmp_path / "a.mp4", frames)
    video = phone.upload({"walk.MP4": (tmp_path / "a.mp4").read_bytes()})
    archive = phone.upload({"toys.zip": zipped})
    packed = phone.upload({"walk.zip": zip_of({"walk/a.mp4": (tmp_path / "a.mp4").read_bytes()})})
    assert phone.until(video, "queued")["thumbnail"]
    assert phone.until(archive, "queued")["place"] == 2
    assert phone.until(packed, "queued")["thumbnail"]
    assert (folder / "captures" / archive / "capture" / "toys" / "transforms.json").is_file()
    assert not (folder / "captures" / archive / "upload" / "0001.zip").exists()


@pytest.mark.parametrize("damage", [lambda content: bytes(len(content)), lambda content: content[:-400]])
@pytest.mark.parametrize("is_posed", [False, True])
def test_damaged_photographs(
    serve: Serve, folder: Path, photographs: dict[str, bytes], damage: Callable[[bytes], bytes], is_posed: bool
) -> None:
    """Training leaves them out, so the others are taken, and one of these shows what the capture is of."""
    files = {**photographs, "IMG_9.JPG": damage(photographs["IMG_9.JPG"])}
    if is_posed:
        files = {"toys.zip": zip_of(posed(files))}
    phone = serve()
    assert phone.until(phone.upload(files), lambda told: told["state"] != "checking")["state"] == "queued"
    assert phone.shelf["captures"][0]["thumbnail"]


def posed(photographs: dict[str, bytes]) -> dict[str, bytes]:
    """The files of a capture that states their poses."""
    frames = [{"file_path": name, "transform_matrix": np.eye(4).tolist()} for name in photographs]
    document = {"fl_x": 100.0, "w": 96, "h": 72, "frames": frames}
    return {**photographs, "transforms.json": json.dumps(document).encode()}


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({f"{i}.jpg": b"no picture" for i in range(3)}, r"^0\.jpg: is damaged, or no image: 0 of 3"),
        (
            {"a.zip": zip_of({f"a/b/c/d/{i}.jpg": b"" for i in range(3)})},
            r"are in a/b/c/d, .*: zip that folder alone$",
        ),
        ({"a.zip": zip_of(posed({f"{i}.jpg": b"\xff" for i in range(3)}))}, r"^toys/1\.jpg: is damaged.* all others"),
        ({"walk.mp4": b"no video"}, r"walk\.mp4: cannot be opened as a video"),
        ({"a.zip": b"no archive"}, r"a\.zip: is no whole zip file"),
        ({"a.zip": zip_of({"../x": b"harm"})}, r"a\.zip: holds '\.\./x', expected names"),
        ({"a.zip": zip_of({"notes.txt": b"hello"})}, r"toys: not a capture of a supported format\.$"),
        ({"a.r3d": zip_of({"metadata": b"{}"})}, r"a\.r3d"),
    ],
)
def test_what_is_unusable(serve: Serve, folder: Path, files: dict[str, bytes], message: str) -> None:
    phone = serve()
    told = phone.until(phone.upload(files), "unusable")
    assert re.search(message, told["message"]), told["message"]
    assert str(folder) not in told["message"], "paths on the server are its own affair"
    assert phone.tell(f"captures/{told['id']}/train", {"effort": "quick"}).status == 409


@pytest.mark.parametrize(
    ("said", "status", "sentence"),
    [
        ([], 400, "a list of files"),
        ({"files": []}, 400, "a list of files"),
        ({"files": [{"name": "a.mov"}]}, 400, "its size"),
        ({"files": [{"name": "a.mov", "size": 1.5}]}, 400, "its size"),
        ({"files": [{"name": "a.mov", "size": True}]}, 400, "its size"),
        ({"files": [{"name": "a.mov", "size": -1}]}, 400, "its size"),
        ({"files": [{"name": "a.mov", "size": 0}]}, 415, "a.mov is empty"),
        ({"files": [{"name": "", "size": 1}]}, 400, "names of files"),
        ({"files": [{"name": "\ud800.mov", "size": 1}]}, 400, "names of files"),
        ({"files": [{"name": "a" * 300 + ".mov", "size": 1}]}, 400, "names of files"),
        ({"files": [{"name": "a.exe", "size": 1}]}, 415, "a.exe is no photograph, video or zip file"),
        ({"files": [{"name": "zip", "size": 1}]}, 415, "no photograph"),
        ({"files": [{"name": "a.mov", "size": 1}, {"name": "b.mov", "size": 1}]}, 415, "one video"),
        ({"files": [{"name": "a.mov", "size": 1}, {"name": "b.jpg", "size": 1}]}, 415, "one video"),
        ({"files": [{"name": "a.jpg", "size": 1}] * 2}, 415, "at least 3 photographs"),
        ({"files": [{"name": "a.jpg", "size": 1}] * 2001}, 413, "2,001 files"),
        ({"files": [{"name": "a.mov", "size": 2_000_001}]}, 413, "at most 2 MB"),
        ({"files": [{"name": "a.mov", "size": 10**400}]}, 413, "at most 2 MB"),
        ({"files": [{"name": "a.jpg", "size": 1_000_000}] * 3}, 413, "3 MB to upload, expected at most 2 MB"),
        ({"files": [{"name": "a.mov", "size": 1}], "title": " \n "}, 400, "a title of 1 to 100"),
        ({"files": [{"name": "a.mov", "size": 1}], "title": "x" * 101}, 400, "a title of 1 to 100"),
        ({"files": [{"name": "a.mov", "size": 1}], "title": "\udfff"}, 400, "a title of 1 to 100"),
        ({"files": [{"name": "a.mov", "size": 1}], "title": 7}, 400, "a title"),
        ({"files": [{"name": "a.mov", "size": 1}], "title": "x", "effort": "--help"}, 400, "efforts quick, best"),
    ],
)
def test_what_is_not_taken(serve: Serve, folder: Path, said: Any, status: int, sentence: str) -> None:
    phone = serve(max_bytes=2_000_000)
    answer = phone.tell("captures", said)
    assert (answer.status, sentence in answer.json["error"]) == (status, True), answer.body
    assert list((folder / "captures").iterdir()) == []


def test_a_body_that_is_not_packed_as_it_says(serve: Serve) -> None:
    """It is the request's fault, not the server's, whose log stays quiet."""
    phone = serve()
    answer = phone.tell("captures", {}, **{"Content-Encoding": "gzip"})
    assert (answer.status, answer.json["error"]) == (400, "the request's body is broken")


@pytest.mark.parametrize(
    "name", ["../../x.mov", "/etc/x.mov", "C:\\x.mov", "CON.mov", "nul.mov", "a\x00.mov", "..mov", "-rf.mov", "💩.mov"]
)
def test_odd_names_are_only_data(serve: Serve, folder: Path, name: str) -> None:
    phone = serve()
    before = below(folder.parent)
    begun = phone.begin({name: b"abc"}, title=name + " ").json
    assert phone.put(begun["id"], 1, 0, b"ab").json == {"received": 2}
    inner = f"shelf/captures/{begun['id']}"
    made = {inner, f"{inner}/about.json", f"{inner}/upload", f"{inner}/upload/0001.mov"}
    assert below(folder.parent) - before == made
    told = fetch(phone.url, f"captures/{begun['id']}/files.json").json
    assert told == [{"number": 1, "name": name, "size": 3, "received": 2}]


def test_without_the_secret(serve: Serve, folder: Path) -> None:
    phone = serve()
    identity = phone.begin(VIDEO).json["id"]
    before = below(folder)
    paths = ["shelf.json", "captures", f"captures/{identity}/files/1?offset=0", f"captures/{identity}/delete", ""]
    for path in (*paths, f"captures/{identity}/view/", "trash/empty", "shelf/main.js"):
        for method, body in (("GET", None), ("POST", b"{}"), ("PUT", b"x"), ("DELETE", None)):
            headers = {"Origin": origin_of(phone.url)}
            for start in ("/", "/wrong/"):
                answer = fetch(phone.url, start + path, method=method, body=body, headers=headers)
                assert (answer.status, answer.body) == (403, b"Forbidden"), (method, path)
    assert below(folder) == before


def test_other_sites_change_nothing(serve: Serve) -> None:
    phone = serve()
    identity = phone.begin(VIDEO).json["id"]
    for origin in ("https://evil.example", "null", origin_of(phone.url) + "0"):
        assert phone.tell(f"captures/{identity}/delete", Origin=origin).status == 403
        assert phone.put(identity, 1, 0, b"x", Origin=origin).status == 403
    path = f"captures/{identity}/delete"
    assert fetch(phone.url, path, method="POST", body=b"{}").status == 403, "a request without an origin"
    assert phone.tell(path, Host="evil.example").status == 403
    assert fetch(phone.url, "shelf.json", body=b"x").status == 413
    assert fetch(phone.url, path).status == 405
    assert phone.capture(identity)["state"] == "uploading"


def test_paths_that_climb(serve: Serve, folder: Path) -> None:
    (folder.parent / "secret.txt").write_text("secret")
    phone = serve()
    identity = phone.begin(VIDEO).json["id"]
    for climb in ("..", "%2e%2e", "..%2f..", "%2e%2e%2f%2e%2e%2f%2e%2e", "..%5c.."):
        for path in (
            f"captures/{climb}/thumbnail.jpg",
            f"captures/{identity}/view/{climb}/secret.txt",
            f"captures/{identity}/view/previews/{climb}%2fsecret.txt",
            f"shelf/{climb}%2f{climb}%2fsecret.txt",
            f"page/{climb}/secret.txt",
        ):
            answer = fetch(phone.url, path)
            assert answer.status in (403, 404, 500), path
            assert b"secret" not in answer.body
        for path in (f"captures/{climb}/delete", f"captures/{identity}%2f..%2f../delete"):
            assert phone.tell(path).status in (403, 404, 405)
        answer = phone.put(f"{identity}/{climb}/{climb}", 1, 0, b"x")
        assert answer.status in (403, 404, 405)
    assert phone.capture(identity)["state"] == "uploading"


def test_an_interrupted_upload_goes_on(serve: Serve, folder: Path) -> None:
    phone, content = serve(), VIDEO["walk.mov"]
    identity = phone.begin(VIDEO).json["id"]
    assert phone.put(identity, 1, 0, content[:1000]).json == {"received": 1000}
    # A gap, another file, and too much of it are refused with what has arrived.
    assert phone.put(identity, 1, 1001, content[1001:]).json["received"] == 1000
    assert phone.put(identity, 1, 900, bytes(200)).status == 409
    assert phone.put(identity, 1, 1000, content).status == 413
    for number, offset in ((0, "0"), (2, "0"), (1, "-1"), (1, "x"), (1, ""), (1, "9" * 20)):
        headers = {"Origin": origin_of(phone.url)}
        path = f"captures/{identity}/files/{number}?offset={offset}"
        assert fetch(phone.url, path, method="PUT", body=b"x", headers=headers).status in (400, 404)
    assert phone.capture(identity)["received"] == 1000
    # A piece whose response was lost comes again, and is no harm.
    assert phone.put(identity, 1, 500, content[500:1500]).json == {"received": 1500}
    assert (folder / "captures" / identity / "upload" / "0001.mov").read_bytes() == content[:1500]
    assert phone.put(identity, 1, 1400, content[1400:]).json == {"received": 2048}
    assert phone.put(identity, 1, 0, content).status == 404, "what is complete cannot be changed"
    phone.until(identity, "unusable")


@contextmanager
def half_a_piece(phone: Phone, identity: str) -> Iterator[socket.socket]:
    """A connection on which a part of a piece of the upload was sent."""
    parts = urlsplit(phone.url)
    path = f"{parts.path}captures/{identity}/files/1?offset=0"
    head = (
        f"PUT {path} HTTP/1.1\r\nHost: {parts.netloc}\r\nOrigin: {origin_of(phone.url)}\r\nContent-Length: 9000\r\n\r\n"
    )
    with socket.create_connection((str(parts.hostname), parts.port), timeout=20) as connection:
        connection.sendall(head.encode() + bytes(5000))
        yield connection


def test_a_connection_that_breaks(serve: Serve) -> None:
    """Of a piece that does not arrive whole, nothing is kept; a piece that is too large is not read."""
    phone, content = serve(), bytes(6_000_000)
    identity = phone.begin({"walk.mov": content}).json["id"]
    with half_a_piece(phone, identity):
        pass
    assert phone.put(identity, 1, 0, b"").json == {"received": 0}
    assert phone.put(identity, 1, 0, content[:MAX_PIECE]).json == {"received": MAX_PIECE}
    with suppress(ConnectionError, http.client.HTTPException):  # it may hang up while the rest is being sent
        assert phone.put(identity, 1, MAX_PIECE, bytes(MAX_PIECE + 1)).status == 413
    assert phone.capture(identity)["received"] == MAX_PIECE


@pytest.mark.parametrize("is_gone", [True, False])
def test_a_piece_that_nobody_wants(serve: Serve, is_gone: bool) -> None:
    """Its upload was deleted or is complete: it is refused before it has arrived."""
    phone = serve()
    identity = phone.upload({"walk.mov": b"no video"})
    if is_gone:
        phone.tell(f"captures/{identity}/delete")
    with half_a_piece(phone, identity) as connection:
        assert connection.recv(1000).startswith(b"HTTP/1.1 404 ")


def test_what_was_unusable_is_checked_again(serve: Serve, zipped: bytes) -> None:
    """The disk has no room for one of the files, and later it has."""
    content = io.BytesIO(zipped)
    with zipfile.ZipFile(content, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("toys/large.txt", bytes(4_000_000))
    phone = serve()
    with files_of_at_most(2_000_000):
        identity = phone.upload({"toys.zip": content.getvalue()})
        assert "File too large" in phone.until(identity, "unusable")["message"]
    assert phone.tell(f"captures/{identity}/check").status == 200
    assert phone.until(identity, "queued")["message"] == ""
    assert phone.tell(f"captures/{identity}/check").status == 409


def test_taken_out_of_the_queue(serve: Serve, folder: Path) -> None:
    """What was to be trained anew, and then was not, can go on where it ended, with the effort that it had."""
    entry = left_behind(folder, "trained", SCENE, CHECKPOINT, record={"interrupted": True})
    phone = serve()
    assert phone.capture(entry.id)["can_go_on"]
    assert phone.tell(f"captures/{entry.id}/train", {"effort": "best"}).status == 200
    assert phone.tell(f"captures/{entry.id}/stop").status == 200
    told = phone.capture(entry.id)
    assert (told["state"], told["effort"], told["can_go_on"]) == ("stopped", "quick", True)


def test_what_goes_on(serve: Serve, folder: Path) -> None:
    """A run that was killed before it had a scene does, but not a finished one: its result stays."""
    killed = left_behind(folder, "failed", UNFINISHED)
    finished = left_behind(folder, "trained", SCENE, CHECKPOINT, record={"interrupted": False})
    phone = serve()
    assert [phone.capture(each.id)["can_go_on"] for each in (killed, finished)] == [True, False]
    assert phone.capture(killed.id)["result"] is None
    assert phone.tell(f"captures/{killed.id}/go-on").status == 200
    assert phone.capture(killed.id)["state"] == "queued"
    answer = phone.tell(f"captures/{finished.id}/go-on")
    assert (answer.status, answer.json["error"]) == (
        409,
        "toys has no unfinished run to go on with: train it again",
    )
    assert phone.capture(finished.id)["state"] == "trained"


def test_two_uploads_at_the_same_time(serve: Serve, photographs: dict[str, bytes]) -> None:
    phone, identities = serve(), []

    def upload(name: str) -> None:
        identities.append(phone.upload(photographs, title=name))

    threads = [threading.Thread(target=upload, args=(name,)) for name in "abc"]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(identities)) == 3
    assert sorted(phone.until(each, "queued")["title"] for each in identities) == ["a", "b", "c"]
    assert sorted(phone.capture(each)["place"] for each in identities) == [1, 2, 3]


def test_full_disk(serve: Serve, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    phone = serve()
    identity = phone.begin(VIDEO).json["id"]
    phone.put(identity, 1, 0, VIDEO["walk.mov"][:1000])
    with files_of_at_most(1500):
        answer = phone.put(identity, 1, 1000, VIDEO["walk.mov"][1000:])
    assert (answer.status, "disk is full" in answer.json["error"]) == (507, True)
    assert phone.put(identity, 1, 1000, VIDEO["walk.mov"][1000:]).json == {"received": 2048}
    with files_of_at_most(50):
        answer = phone.begin(VIDEO, title="no room")
    assert (answer.status, answer.json["error"]) == (507, NO_ROOM)
    assert len(phone.shelf["captures"]) == len(list((folder / "captures").iterdir())) == 1
    monkeypatch.setattr(shelf, "RESERVE", 1 << 60)
    answer = phone.begin(VIDEO)
    assert (answer.status, "disk is full (0 MB are free" in answer.json["error"]) == (507, True)


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT])
def test_full_disk_at_a_file(serve: Serve, folder: Path, monkeypatch: pytest.MonkeyPatch, code: int) -> None:
    """The disk has no room for one more name, or the user's share of it has none; later it has."""
    phone = serve()
    identity = phone.begin(VIDEO).json["id"]
    before = below(folder)

    def fail(*_: object, **__: object) -> None:
        raise OSError(code, os.strerror(code))

    with monkeypatch.context() as patch:
        patch.setattr(pieces, "_write", fail)
        patch.setattr(Path, "write_text", fail)
        patch.setattr(Path, "mkdir", fail)
        answers = [phone.put(identity, 1, 0, VIDEO["walk.mov"]), phone.begin(VIDEO)]
        answers.append(phone.tell(f"captures/{identity}/rename", {"title": "other"}))
    for answer in answers:
        assert (answer.status, "delete something there" in answer.json["error"]) == (507, True), answer.body
    assert below(folder) - before == {f"captures/{identity}/upload/0001.mov"}
    assert (phone.capture(identity)["title"], phone.capture(identity)["received"]) == ("toys", 0)
    assert phone.put(identity, 1, 0, VIDEO["walk.mov"]).json == {"received": 2048}


def test_full_disk_at_the_end_of_an_upload(serve: Serve) -> None:
    """It is checked, although the disk has no room to note that it is complete."""
    phone, content = serve(), b"no video"
    identity = phone.begin({"walk.mov": content}).json["id"]
    with files_of_at_most(50):
        answer = phone.put(identity, 1, 0, content)
    assert (answer.status, "disk is full (the upload is complete, and" in answer.json["error"]) == (507, True)
    phone.until(identity, "unusable")


def test_full_disk_at_a_change(serve: Serve, folder: Path, photographs: dict[str, bytes]) -> None:
    """What a page asks for is done in memory and on disk, or not at all, and can be asked for again."""
    phone = serve()
    good, bad = phone.upload(photographs), phone.upload({"walk.mov": b"no video"})
    phone.until(good, "queued")
    phone.until(bad, "unusable")
    changes: list[tuple[str, str, Any]] = [
        (good, "rename", {"title": "other"}),
        (good, "stop", None),
        (good, "train", {"effort": "best"}),
        (good, "stop", None),
        (bad, "check", None),
    ]
    for identity, action, content in changes:
        shown = phone.shelf["captures"]
        kept = {path: path.read_bytes() for path in folder.glob("captures/*/about.json")}
        with files_of_at_most(50):
            answer = phone.tell(f"captures/{identity}/{action}", content)
        assert (answer.status, answer.json["error"]) == (507, NO_ROOM), action
        assert phone.shelf["captures"] == shown
        assert {path: path.read_bytes() for path in kept} == kept
        assert list(folder.glob("captures/*/.*")) == [], "nothing half-written is left"
        assert phone.tell(f"captures/{identity}/{action}", content).status == 200
        assert phone.shelf["captures"] != shown
    phone.until(bad, "unusable")


def test_unfinished_uploads_are_few(serve: Serve, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(uploads, "MOST_UNFINISHED", 2)
    phone = serve()
    begun = [phone.begin(VIDEO) for _ in range(3)]
    assert [answer.status for answer in begun] == [200, 200, 409]
    # One whose folder was taken away is in nobody's way.
    gone = begun[0].json["id"]
    shutil.rmtree(folder / "captures" / gone)
    assert phone.begin(VIDEO).status == 200
    assert phone.tell(f"captures/{gone}/delete").status == 200
    assert phone.tell(f"captures/{gone}/delete").status == 404


def test_rename_delete_restore(serve: Serve, folder: Path, photographs: dict[str, bytes]) -> None:
    phone = serve()
    identity, other = phone.upload(photographs), phone.upload(photographs, title="other")
    phone.until(other, "queued")
    assert phone.tell(f"captures/{identity}/rename", {"title": "<b>new</b>"}).status == 200
    assert phone.tell(f"captures/{identity}/rename", {"title": ""}).status == 400
    assert phone.capture(identity)["title"] == "<b>new</b>"
    assert phone.tell(f"captures/{identity}/delete").status == 200
    assert [each["title"] for each in phone.shelf["deleted"]] == ["<b>new</b>"]
    assert phone.capture(other)["place"] == 1
    assert phone.tell(f"captures/{identity}/delete").status == 404
    assert phone.tell(f"captures/{identity}/restore").status == 200
    assert phone.tell(f"captures/{identity}/restore").status == 404
    assert (phone.capture(identity)["place"], phone.capture(other)["place"]) == (1, 2)
    assert phone.tell(f"captures/{identity}/stop").status == 200
    assert phone.capture(identity)["state"] == "stopped"
    assert phone.tell(f"captures/{identity}/train", {"effort": "none"}).status == 400
    assert phone.tell(f"captures/{identity}/train", {"effort": "best"}).status == 200
    assert phone.capture(identity)["place"] == 2
    phone.tell(f"captures/{identity}/delete")
    assert phone.tell("trash/empty").status == 200
    assert list((folder / "trash").iterdir()) == []
    assert phone.tell(f"captures/{identity}/restore").status == 404


def test_a_last_piece_that_is_written_while_its_capture_is_deleted(serve: Serve, folder: Path) -> None:
    phone = serve()
    identity = phone.begin(VIDEO).json["id"]
    phone.tell(f"captures/{identity}/delete")
    (folder / "trash" / identity / "upload" / "0001.mov").write_bytes(VIDEO["walk.mov"])
    phone.tell(f"captures/{identity}/restore")
    phone.until(identity, "unusable")  # it was checked, and is no video


def test_uploads_and_queue_survive_the_server(folder: Path, photographs: dict[str, bytes]) -> None:
    with serving_folder(folder, ServeOptions({"quick": ()}, "quick")) as (page, _):
        phone = Phone(page.url)
        ready = phone.upload(photographs)
        phone.until(ready, "queued")
        half = phone.begin(VIDEO).json["id"]
        phone.put(half, 1, 0, VIDEO["walk.mov"][:700])
    with serving_folder(folder, ServeOptions({"quick": ()}, "quick")) as (again, _):
        assert again.url == page.url, "the phone's page need not be opened anew"
        assert phone.capture(ready)["state"] == "queued"
        told = phone.capture(half)
        assert (told["state"], told["received"], told["active"]) == ("uploading", 700, False)
        assert phone.put(half, 1, 600, VIDEO["walk.mov"][600:]).json == {"received": 2048}


def test_downloads_and_the_viewer(serve: Serve, folder: Path, photographs: dict[str, bytes], tmp_path: Path) -> None:
    phone = serve()
    identity = phone.upload(photographs, title='a "quoted"/ü\\title;')
    phone.until(identity, "queued")
    result = folder / "captures" / identity / "result"
    result.mkdir()
    rng = np.random.default_rng(0)
    scene = Gaussians(*(rng.normal(size=(50, *tail)) for tail in ((3,), (3,), (4,), (), (4, 3))))
    record = {"psnr": 20.5, "iterations": 7, "gaussians": 50, "interrupted": False}
    (result / "run.json").write_text(json.dumps(record))
    assert phone.capture(identity)["result"] is None, "a result's files come one after the other"
    for count, second in ((30, 1), (50, 2)):
        scene.select(np.arange(count)).save(result / "scene.ply")
        os.utime(result / "scene.ply", (second, second))
        told = phone.capture(identity)["result"]
        assert told["bytes"] == (result / "scene.ply").stat().st_size
    assert (told["psnr"], told["gaussians"]) == (20.5, 50)
    for suffix in (".ply", ".spz", ".pgs"):
        answer = fetch(phone.url, f"captures/{identity}/scene{suffix}")
        name = quote('a "quoted"/ü\\title;', safe="")
        assert answer.headers["Content-Disposition"] == f"attachment; filename*=UTF-8''{name}{suffix}"
        (tmp_path / f"told{suffix}").write_bytes(answer.body)
        assert len(read_scene(tmp_path / f"told{suffix}")) == 50
    # The next run writes its scene, evaluates it, and then puts it in place: meanwhile, the page offers the last one.
    scene.select(np.arange(20)).save(result / "scene.ply")
    os.utime(result / "scene.ply", (3, 3))
    (tmp_path / "next.spz").write_bytes(fetch(phone.url, f"captures/{identity}/scene.spz").body)
    assert len(read_scene(tmp_path / "next.spz")) == 20
    assert fetch(phone.url, f"captures/{identity}/scene.exe").status == 404
    view = f"captures/{identity}/view/"
    assert b"<html" in fetch(phone.url, view).body
    assert fetch(phone.url, view + "page/main.js").status == 200
    viewer = fetch(phone.url, view + "viewer.json").json
    assert (viewer["title"], viewer["live"]) == ('a "quoted"/ü\\title;', False)
    assert fetch(phone.url, view + viewer["scene"]["url"]).body == (result / "scene.ply").read_bytes()
    assert fetch(phone.url, view + "live").status == 404


def test_many_downloads_leave_the_page_alone(
    serve: Serve, folder: Path, photographs: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A button that is pressed again and again: the scene is converted once, and meanwhile everything else goes on."""
    phone = serve()
    identity = phone.upload(photographs)
    phone.until(identity, "queued")
    (folder / "captures" / identity / "result").mkdir()
    scene = Gaussians(*(np.zeros((1, *tail)) for tail in ((3,), (3,), (4,), (), (1, 3))))
    scene.save(folder / "captures" / identity / "result" / "scene.ply")
    begun, may_end, statuses = [], threading.Event(), []

    def write(path: Path, scene: Gaussians) -> None:
        begun.append(path.name)
        may_end.wait(60)
        write_scene(path, scene)

    monkeypatch.setattr(downloads, "write_scene", write)

    def get() -> None:
        statuses.append(fetch(phone.url, f"captures/{identity}/scene.spz").status)

    threads = [threading.Thread(target=get) for _ in range(40)]
    for thread in threads:
        thread.start()
    while not begun:
        time.sleep(0.01)
    time.sleep(0.5)  # until all requests have arrived
    try:
        assert fetch(phone.url, "").status == 200
        assert fetch(phone.url, f"captures/{identity}/scene.ply").status == 200
    finally:
        may_end.set()
        for thread in threads:
            thread.join()
    assert (begun, statuses) == (["scene.spz"], [200] * 40)


def test_the_page_and_its_modules(serve: Serve) -> None:
    phone = serve()
    page = fetch(phone.url).body.decode()
    names = [part.split('"')[0] for part in page.split('="shelf/')[1:]]
    assert names
    for name in names:
        source = fetch(phone.url, f"shelf/{name}").body.decode()
        for imported in (part.split('"')[0] for part in source.split('from "./')[1:]):
            assert fetch(phone.url, f"shelf/{imported}").status == 200, imported
    for headers in (fetch(phone.url).headers, fetch(phone.url, "shelf.json").headers):
        assert "script-src 'self'" in headers["Content-Security-Policy"]
    assert fetch(phone.url, "shelf/routes.py").status == 404


@pytest.mark.skipif(os.name == "nt", reason="links need rights there")
def test_results_that_are_links(serve: Serve, folder: Path) -> None:
    phone = serve()
    identity = phone.begin(VIDEO).json["id"]
    (folder.parent / "secret").write_bytes(b"secret")
    (folder / "captures" / identity / "thumbnail.jpg").symlink_to(folder.parent / "secret")
    assert fetch(phone.url, f"captures/{identity}/thumbnail.jpg").status == 404


def test_a_picture_that_is_huge(serve: Serve) -> None:
    """Its header states 40,000 pixels a side: it is refused before they are decoded."""
    content = bytearray(jpeg(np.zeros((16, 16, 3), np.uint8)))
    at = content.index(b"\xff\xc0") + 5
    content[at : at + 4] = (40_000).to_bytes(2, "big") * 2
    phone = serve()
    told = phone.until(phone.upload({f"{i}.jpg": bytes(content) for i in range(3)}), "unusable")
    assert re.match(r"\d\.jpg: has more than 250,000,000 pixels", told["message"])
