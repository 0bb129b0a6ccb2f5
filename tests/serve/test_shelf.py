"""The folder: what is kept, what comes back, and what is not ours."""

from __future__ import annotations

import json
import os
import time
from dataclasses import replace
from pathlib import Path

import pytest

from files.test_full_disk import files_of_at_most
from pocketgs.errors import PocketGSError
from pocketgs.serve.address import KeptAddress, keep_address, kept_address
from pocketgs.serve.entry import Entry, UploadedFile
from pocketgs.serve.server import ServeOptions, serving_folder
from pocketgs.serve.shelf import Shelf, delete_folders, new_id


def an_entry(title: str = "toys") -> Entry:
    return Entry(new_id(), title, "video", (UploadedFile("a.mov", "0001.mov", 5),), "quick", time.time())


def test_captures_are_kept(tmp_path: Path) -> None:
    shelf = Shelf(tmp_path)
    entry = an_entry('<img src=x> "\u202etitle" \N{PILE OF POO}')
    shelf.add(entry)
    changed = shelf.save(replace(entry, state="training", begun=2.5, flags=("--max-size", "8"), process=7))
    assert Shelf(tmp_path).entries == {entry.id: changed}
    assert shelf.received(changed) == [0]
    (shelf.place(entry) / "upload" / "0001.mov").write_bytes(b"abc")
    assert shelf.received(changed) == [3]


def test_deleting_and_restoring(tmp_path: Path) -> None:
    shelf = Shelf(tmp_path)
    entry = an_entry()
    shelf.add(entry)
    (shelf.place(entry) / "upload" / "0001.mov").write_bytes(b"abc")
    shelf.delete(entry)
    assert shelf.entries == {}
    again = Shelf(tmp_path)
    [deleted] = again.deleted.values()
    assert time.time() - (deleted.deleted or 0) < 60
    assert again.restore(deleted) == entry
    assert (again.place(entry) / "upload" / "0001.mov").read_bytes() == b"abc"
    again.delete(entry)
    assert again.empty_trash(60.0) == []
    assert list(again.deleted) == [entry.id]
    [deleted] = again.deleted.values()
    again.save(replace(deleted, deleted=time.time() - 61.0))
    delete_folders(again.empty_trash(60.0))
    assert again.deleted == {}
    assert list((tmp_path / "trash").iterdir()) == []


def test_a_move_that_was_cut_off(tmp_path: Path) -> None:
    """The server was killed between moving a folder and writing its file: the folder decides."""
    shelf = Shelf(tmp_path)
    entry = an_entry()
    shelf.add(entry)
    os.rename(tmp_path / "captures" / entry.id, tmp_path / "trash" / entry.id)
    [deleted] = Shelf(tmp_path).deleted.values()
    assert deleted.deleted is not None
    os.rename(tmp_path / "trash" / entry.id, tmp_path / "captures" / entry.id)
    assert Shelf(tmp_path).entries == {entry.id: entry}


def test_what_is_not_ours_stays(tmp_path: Path) -> None:
    shelf = Shelf(tmp_path)
    entry = an_entry()
    shelf.add(entry)
    (tmp_path / "captures" / "holiday").mkdir()
    (tmp_path / "captures" / new_id()).mkdir()
    broken = tmp_path / "captures" / "20260101-000000-abcdef"
    broken.mkdir()
    for content in ("{", "[]", "{}", json.dumps({**entry.to_json(), "state": "lost"}), json.dumps(entry.to_json())):
        (broken / "about.json").write_text(content)
        again = Shelf(tmp_path)
        assert list(again.entries) == [entry.id]
        [warning] = again.warnings
        assert "about.json" in warning
    climbing = {**entry.to_json(), "id": broken.name, "files": [{"name": "a", "stored": "../../x", "size": 1}]}
    (broken / "about.json").write_text(json.dumps(climbing))
    assert list(Shelf(tmp_path).entries) == [entry.id]


@pytest.mark.skipif(os.name == "nt", reason="links need rights there")
def test_links_that_lead_out(tmp_path: Path) -> None:
    outside, folder = tmp_path / "outside", tmp_path / "shelf"
    outside.mkdir()
    folder.mkdir()
    (folder / "captures").symlink_to(outside, target_is_directory=True)
    with pytest.raises(PocketGSError, match=r"captures: is a link, expected a folder"):
        Shelf(folder)
    (folder / "captures").unlink()
    shelf = Shelf(folder)
    entry = an_entry()
    shelf.add(entry)
    os.rename(shelf.place(entry), outside / entry.id)
    (folder / "captures" / entry.id).symlink_to(outside / entry.id, target_is_directory=True)
    assert Shelf(folder).entries == {}
    for work in (lambda: shelf.save(entry), lambda: shelf.delete(entry)):
        with pytest.raises(PocketGSError, match="a link has taken its place"):
            work()
    # The user's own folder may be behind a link.
    (tmp_path / "link").symlink_to(folder, target_is_directory=True)
    assert Shelf(tmp_path / "link").folder == folder.resolve()


def test_full_disk_keeps_what_was_known(tmp_path: Path) -> None:
    shelf = Shelf(tmp_path)
    entry = an_entry()
    shelf.add(entry)
    with files_of_at_most(20), pytest.raises(PocketGSError, match=r"about\.json: cannot be written"):
        shelf.save(replace(entry, title="other"))
    assert shelf.entries[entry.id].title == "other"
    assert Shelf(tmp_path).entries == {entry.id: entry}
    with files_of_at_most(20):
        shelf.delete(entry)
    assert list(Shelf(tmp_path).deleted) == [entry.id], "deleting makes room, and needs none"


def test_one_server_at_a_time(tmp_path: Path) -> None:
    with (
        serving_folder(tmp_path, ServeOptions()),
        pytest.raises(PocketGSError, match="another pocketgs process"),
        serving_folder(tmp_path, ServeOptions()),
    ):
        pass


def test_the_address_stays(tmp_path: Path) -> None:
    urls = []
    for _ in range(2):
        with serving_folder(tmp_path, ServeOptions()) as (page, _warnings):
            urls.append(page.url)
    assert urls[0] == urls[1]
    kept = tmp_path / ".pocketgs" / "address.json"
    if os.name != "nt":
        assert kept.stat().st_mode & 0o077 == 0, "the secret is the user's alone"
    for broken in ("{", '{"token": "short", "port": 80}', '{"token": "../../../../../../../../..", "port": 80}'):
        kept.write_text(broken)
        assert kept_address(tmp_path).token not in broken
    keep_address(tmp_path, KeptAddress("a" * 22, 1))
    assert kept_address(tmp_path) == KeptAddress("a" * 22, 1)
