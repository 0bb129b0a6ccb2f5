"""Publishing is atomic, whichever file operation fails."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from attack.publishing import (
    TROUBLES,
    Trouble,
    attack_by_two,
    attack_moment,
    attack_operation,
    content_of,
    operations_of,
    prepare,
    prepared,
    publish,
    version_in,
)
from pocketgs.errors import PocketGSError
from pocketgs.files import journal
from pocketgs.files.journal import settle

WITH_FORK = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")


@WITH_FORK
@pytest.mark.parametrize("trouble", TROUBLES)
def test_trouble_at_file_operations(trouble: Trouble) -> None:
    """At every sixth one, others for each trouble; `tests/attack/publishing.py` tries all of them."""
    with prepared() as folder:
        count = operations_of(folder, lambda: publish(folder, 3))
    for at in range(TROUBLES.index(trouble), count, 6):
        attack_operation(at, trouble)


@WITH_FORK
def test_trouble_of_the_next_reader_too() -> None:
    for at, again in [(95, 5), (100, 20), (105, 9), (110, 30)]:
        attack_operation(at, "kill", again)


@WITH_FORK
def test_kills_at_random_moments() -> None:
    for moment in (0.0, 0.01, 0.02, 0.03):
        attack_moment(moment)


@WITH_FORK
def test_two_at_a_time() -> None:
    seen = attack_by_two(10, killed=False)
    assert seen["published"] >= 10
    attack_by_two(10, killed=True)


def test_a_file_that_refuses_to_be_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Like a file that is open on Windows, or immutable: the old result stays, and the new one is kept."""
    prepare(tmp_path)
    replace = os.replace

    def refuse(source: Path, target: Path) -> None:
        if Path(source) == tmp_path / "scene.ply":
            raise PermissionError(1, "Operation not permitted", str(source))
        replace(source, target)

    monkeypatch.setattr(journal.os, "replace", refuse)
    with pytest.raises(PocketGSError, match=r"scene\.ply: Operation not permitted\); it is in .*unpublished-"):
        publish(tmp_path, 3)
    assert version_in(tmp_path) == 2
    (kept,) = tmp_path.glob("unpublished-*")
    assert version_in_kept(kept) == 3
    monkeypatch.undo()
    publish(tmp_path, 4)
    assert version_in(tmp_path) == 4
    assert version_in_kept(kept) == 3


def version_in_kept(folder: Path) -> int:
    version = int((folder / "run.json").read_bytes()[:1])
    assert {name: (folder / name).read_bytes() for name in content_of(version)} == content_of(version)
    return version


def test_what_nobody_can_complete_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, contents: Callable[[Path], dict[str, bytes]]
) -> None:
    prepare(tmp_path)

    def fail(source: Path, target: Path) -> None:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(journal.os, "replace", fail)
    publishing_stops = pytest.raises(PocketGSError)
    with publishing_stops:
        publish(tmp_path, 3)
    monkeypatch.undo()
    assert version_in(tmp_path) == 2
    (tmp_path / ".pocketgs" / "pending").mkdir()
    with pytest.raises(PocketGSError, match="a half-published result there cannot be completed"):
        settle(tmp_path)
