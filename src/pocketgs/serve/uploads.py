"""Uploads: captures that are declared, arrive in pieces, and are handed to the queue when they are complete."""

from __future__ import annotations

import asyncio
import time
from collections import defaultdict
from contextlib import suppress
from dataclasses import replace
from typing import Any

from pocketgs.errors import PocketGSError
from pocketgs.serve.declaration import Bounds, declared
from pocketgs.serve.entry import Entry
from pocketgs.serve.pieces import put_piece
from pocketgs.serve.queue import Queue
from pocketgs.serve.refused import RefusedError, is_full, no_room
from pocketgs.serve.shelf import UPLOAD, Shelf, free_bytes

MOST_UNFINISHED = 20


class Uploads:
    """The uploads to a shelf.

    Args:
        shelf: that they go to.
        queue: that is told when one is complete.
        bounds: of each.
    """

    def __init__(self, shelf: Shelf, queue: Queue, bounds: Bounds) -> None:
        self._shelf, self._queue, self._bounds = shelf, queue, bounds
        self._writing: defaultdict[str, asyncio.Lock] = defaultdict(asyncio.Lock)
        self._last_piece: dict[str, float] = {}

    def last_piece(self, entry: Entry) -> float:
        """When the last piece of a capture arrived, by the monotonic clock."""
        return self._last_piece.get(entry.id, float("-inf"))

    def begin(self, said: Any) -> Entry:
        """Make room for an upload; `said` as for `declared`.

        Raises:
            RefusedError: it is out of bounds, or the disk has no room for it.
        """
        entry = declared(said, self._bounds)
        expected = self._expected()
        if len(expected) >= MOST_UNFINISHED:
            raise RefusedError(409, f"{len(expected)} uploads are unfinished: continue or delete one of them first")
        free = free_bytes(self._shelf.folder) - sum(expected)
        if entry.bytes > free:
            raise no_room(f"{max(0, free) / 1e6:,.0f} MB are free for this upload of {entry.bytes / 1e6:,.0f} MB")
        self._shelf.add(entry)
        return entry

    def _expected(self) -> list[int]:
        """How many bytes each unfinished upload still lacks."""
        expected = []
        for entry in self._shelf.entries.values():
            if entry.state == "uploading":
                with suppress(PocketGSError):  # its folder was taken away: the page shows no such upload
                    expected.append(entry.bytes - sum(self._shelf.received(entry)))
        return expected

    def unfinished(self, identity: str, number: int) -> Entry:
        """The capture that expects pieces of a file.

        Args:
            identity: of the capture.
            number: of the file, from 1.

        Raises:
            RefusedError: there is none.
        """
        entry = self._shelf.entries.get(identity)
        if entry is None or entry.state != "uploading" or not 1 <= number <= len(entry.files):
            raise RefusedError(404, "no such upload: it is complete, or was deleted")
        return entry

    async def put(self, identity: str, number: int, offset: int, piece: bytes) -> int:
        """Write a piece of a file; returns how many bytes of it have arrived.

        Args:
            identity: of the capture.
            number: of the file, from 1.
            offset: of the piece in the file.
            piece: its bytes.

        Raises:
            RefusedError: it does not belong there, or the disk is full.
        """
        self.unfinished(identity, number)  # before there is a lock for it
        async with self._writing[identity]:
            entry = self.unfinished(identity, number)
            self._last_piece[identity] = time.monotonic()
            file = entry.files[number - 1]
            path = self._shelf.place(entry) / UPLOAD / file.stored
            try:
                received = await asyncio.to_thread(put_piece, path, file.size, offset, piece)
            except OSError as error:
                if is_full(error):
                    raise no_room("the upload stays as far as it is") from error
                raise RefusedError(500, f"{file.name} cannot be written ({error.strerror or error})") from error
            await self.complete(identity)
            return received

    async def complete(self, identity: str) -> None:
        """Hand a capture to the queue if all of it has just arrived, unless it was deleted meanwhile.

        Raises:
            RefusedError: the disk is too full to note that. The capture is checked all the same.
            PocketGSError: that cannot be noted for another reason; likewise.
        """
        entry = self._shelf.entries.get(identity)
        if entry and entry.state == "uploading" and self._shelf.has_all(entry):
            self._last_piece.pop(identity, None)
            try:
                self._shelf.save(replace(entry, state="checking"))
            except PocketGSError as error:
                if is_full(error):
                    then = "check the capture again if that fails"
                    raise no_room("the upload is complete, and is being checked", then) from error
                raise
            finally:  # on a full disk too: the shelf knows it in memory
                await self._queue.tell()
