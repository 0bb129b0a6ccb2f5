"""Pieces of an upload: they make the file, whatever order and overlap they come in, and nothing else."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from files.test_full_disk import files_of_at_most
from pocketgs.serve.pieces import put_piece
from pocketgs.serve.refused import RefusedError

CONTENT = bytes(range(256)) * 4


@given(pieces=st.lists(st.tuples(st.integers(0, 1100), st.integers(0, 400)), max_size=12))
def test_any_pieces_make_the_file(pieces: list[tuple[int, int]], tmp_path_factory: pytest.TempPathFactory) -> None:
    """The bytes on disk are always the beginning of the file."""
    path = tmp_path_factory.mktemp("upload").resolve() / "0001.jpg"
    path.touch()
    for offset, length in pieces:
        piece = CONTENT[offset : offset + length]
        before = path.stat().st_size
        if offset > before:
            with pytest.raises(RefusedError) as refused:
                put_piece(path, len(CONTENT), offset, piece)
            assert refused.value.facts == ({"received": before} if offset <= len(CONTENT) else {})
        else:
            received = put_piece(path, len(CONTENT), offset, piece)
            assert received == path.stat().st_size == max(before, offset + len(piece))
        assert CONTENT.startswith(path.read_bytes())


@pytest.mark.parametrize(
    ("offset", "piece", "status", "sentence"),
    [
        (5, b"x", 409, "4 bytes have arrived"),
        (2, b"CD", 409, "not the file that was being uploaded"),
        (2, b"cX", 409, "not the file that was being uploaded"),
        (4, b"efghi", 413, "more bytes than the 8"),
        (9, b"", 413, "more bytes than the 8"),
        (10**14, b"x", 413, "more bytes"),
    ],
)
def test_pieces_that_do_not_fit(tmp_path: Path, offset: int, piece: bytes, status: int, sentence: str) -> None:
    path = tmp_path.resolve() / "0001.jpg"
    assert put_piece(path, 8, 0, b"abcd") == 4
    with pytest.raises(RefusedError, match=sentence) as refused:
        put_piece(path, 8, offset, piece)
    assert refused.value.status == status
    assert path.read_bytes() == b"abcd"


def test_full_disk(tmp_path: Path) -> None:
    path = tmp_path.resolve() / "0001.mov"
    put_piece(path, 1000, 0, bytes(300))
    with files_of_at_most(400), pytest.raises(OSError, match="too large"):
        put_piece(path, 1000, 300, bytes(300))
    assert path.stat().st_size == 300
    assert put_piece(path, 1000, 300, bytes(700)) == 1000


@pytest.mark.skipif(not hasattr(os, "O_NOFOLLOW"), reason="no links here")
def test_links_in_the_way(tmp_path: Path) -> None:
    """Another program of this machine puts links where the server will write."""
    outside, upload = tmp_path.resolve() / "outside", tmp_path.resolve() / "upload"
    outside.mkdir()
    upload.mkdir()
    (outside / "victim").write_bytes(b"")
    (upload / "0001.jpg").symlink_to(outside / "victim")
    with pytest.raises(OSError, match="symbolic links"):
        put_piece(upload / "0001.jpg", 3, 0, b"abc")
    (upload / "0002.jpg").mkdir()
    with pytest.raises(OSError, match="directory"):
        put_piece(upload / "0002.jpg", 3, 0, b"abc")
    (tmp_path / "linked").symlink_to(outside, target_is_directory=True)
    with pytest.raises(RefusedError, match="a link has taken the place"):
        put_piece(tmp_path.resolve() / "linked" / "victim", 3, 0, b"abc")
    assert (outside / "victim").read_bytes() == b""
