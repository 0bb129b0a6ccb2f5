"""The queue: complete uploads are checked, and trained one at a time.

The queue is the captures in the states "checking" and "queued" themselves, so it is on disk with them.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from aiohttp import ClientSession

from pocketgs.errors import USER_ERROR, PocketGSError
from pocketgs.files.manifest import PRIVATE
from pocketgs.serve import child
from pocketgs.serve.entry import Entry
from pocketgs.serve.outcome import can_go_on, is_complete, plain_message
from pocketgs.serve.shelf import LOG, RESULT, THUMBNAIL, Shelf, input_of
from pocketgs.serve.thumbnail import show_rendering
from pocketgs.serve.training import Training

SECONDS_TO_CHECK = 900.0


class Queue:
    """Checks and trains a shelf's captures, all on the server's event loop.

    Args:
        shelf: with the captures.
        flags: of `pocketgs train` for each effort.
        max_bytes: bound of what an archive unpacks to.
    """

    def __init__(self, shelf: Shelf, flags: Mapping[str, tuple[str, ...]], max_bytes: int) -> None:
        self._shelf, self._flags, self._max_bytes = shelf, flags, max_bytes
        self._news = asyncio.Condition()
        self._current: tuple[str, Training] | None = None
        self._unwanted: set[str] = set()

    def running(self, identity: str) -> Training | None:
        """The run of a capture, if it is the one that goes on."""
        return self._current[1] if self._current and self._current[0] == identity else None

    def waiting(self) -> list[Entry]:
        """The captures that wait to be trained, the next one first."""
        return sorted(self._in_state("queued"), key=lambda entry: entry.queued)

    async def tell(self) -> None:
        """Look at the shelf again: something on it has changed."""
        async with self._news:
            self._news.notify_all()

    async def enqueue(self, entry: Entry) -> None:
        """Put a capture at the end of the queue; it goes on where its last run ended, if `begun` says when."""
        self._shelf.save(replace(entry, state="queued", queued=time.time(), message=""))
        await self.tell()

    async def stop(self, entry: Entry) -> None:
        """Stop a capture's run, which keeps what was trained, if anything; or take it out of the queue."""
        run = self.running(entry.id)
        if run is None:
            if entry.state == "queued":
                self._shelf.save(replace(entry, state="stopped"))
            return
        self._unwanted.add(entry.id)
        await (run.keep() if run.progress.get("iteration") else self._end(entry.id, run, child.GRACE))

    async def drop(self, entry: Entry) -> None:
        """Forget what is being done with a capture, before it is moved: its run ends at once."""
        self._unwanted.add(entry.id)
        if run := self.running(entry.id):
            await self._end(entry.id, run, grace=0.0)

    async def _end(self, identity: str, run: Training, grace: float) -> None:
        """End a run, even one that is just being started, and wait until the queue knows."""
        while self.running(identity) is run:
            await run.end(grace)
            await asyncio.sleep(0.02)

    async def recover(self) -> None:
        """Take up again what a server that was killed has left half done, and end the run that it left behind."""
        for entry in list(self._shelf.entries.values()):
            if entry.process:
                await asyncio.to_thread(child.end, entry.process)
            if entry.state == "training":
                complete = is_complete(self._shelf.place(entry) / RESULT, entry.begun)
                self._note(entry.id, state="trained" if complete else "queued", process=None)
            elif entry.state == "uploading" and self._shelf.has_all(entry):
                self._note(entry.id, state="checking")  # no more pieces come, which would tell that it is complete

    async def check_uploads(self) -> None:
        """Check complete uploads, until cancelled."""
        while True:
            for entry in self._in_state("checking"):
                try:
                    await self._check(entry)
                except Exception as error:  # whatever it is, other captures wait
                    self._note(entry.id, state="unusable", message=_reason(error))
                await self.tell()
            async with self._news:
                await self._news.wait_for(lambda: self._in_state("checking"))

    async def train_queued(self) -> None:
        """Train what is queued, until cancelled: then the run that goes on is ended, and queued again."""
        async with ClientSession() as client:
            while True:
                async with self._news:
                    await self._news.wait_for(self.waiting)
                entry = self.waiting()[0]
                try:
                    await self._train(entry, client)
                except Exception as error:  # whatever it is, other captures wait
                    self._note(entry.id, state="failed", message=_reason(error), process=None)

    async def _check(self, entry: Entry) -> None:
        place = self._shelf.place(entry)
        self._unwanted.discard(entry.id)
        arguments = ("pocketgs.serve.intake", str(place), str(self._max_bytes))
        process = await child.start(arguments, self._shelf.folder / PRIVATE)
        try:
            said, _ = await asyncio.wait_for(process.communicate(), SECONDS_TO_CHECK)
        except asyncio.TimeoutError:
            self._note(entry.id, state="unusable", message="checking it took too long")
            return
        finally:
            if process.returncode is None:
                process.kill()
                await process.wait()
        if entry.id in self._unwanted:
            return  # it was moved meanwhile: if it has come back, it is checked again
        if process.returncode == 0:
            self._note(entry.id, state="queued", queued=time.time())
            return
        lines = said.decode(errors="replace").strip().splitlines() or [""]
        is_said = process.returncode == USER_ERROR
        message = lines[-1] if is_said else f"checking it ended with status {process.returncode}"
        self._note(entry.id, state="unusable", message=plain_message(message, entry, place))

    async def _train(self, entry: Entry, client: ClientSession) -> None:
        if entry.effort not in self._flags:
            raise PocketGSError(f"effort {entry.effort!r}, expected one of {', '.join(self._flags)}")
        place, flags, run = self._shelf.place(entry), self._flags[entry.effort], Training(client)
        goes_on = flags == entry.flags and can_go_on(place / RESULT, entry.begun)
        begun = entry.begun if goes_on else time.time()
        self._current = (entry.id, run)
        self._unwanted.discard(entry.id)
        self._note(entry.id, state="training", begun=begun, flags=flags, message="")
        try:
            resumed = ("--resume",) if goes_on else ()
            await run.start(input_of(place, entry), place / RESULT, (*flags, *resumed), self._shelf.folder / PRIVATE)
            self._note(entry.id, process=run.process)
            status = await run.finish(place / LOG)
            await self._conclude(entry, status, run, place)
        except asyncio.CancelledError:
            await run.end()
            self._note(entry.id, state="queued", process=None)
            raise
        finally:
            self._current = None

    async def _conclude(self, entry: Entry, status: int, run: Training, place: Path) -> None:
        """Say how a run has ended."""
        if status == 0:
            with suppress(PocketGSError):
                await asyncio.to_thread(show_rendering, place / THUMBNAIL, place / RESULT)
            self._note(entry.id, state="trained", process=None)
        elif entry.id in self._unwanted:
            self._note(entry.id, state="stopped", process=None)
        else:
            message = plain_message(run.last_words, entry, place)
            if status != USER_ERROR:
                message = f"training ended with status {status}; it said last: {message or 'nothing'}"
            self._note(entry.id, state="failed", message=message, process=None)

    def _in_state(self, state: str) -> list[Entry]:
        return [entry for entry in self._shelf.entries.values() if entry.state == state]

    def _note(self, identity: str, **changes: Any) -> None:
        """Change what is known of a capture, unless it was deleted. A full disk does not stop the queue."""
        if entry := self._shelf.entries.get(identity):
            with suppress(PocketGSError):
                self._shelf.save(replace(entry, **changes))


def _reason(error: Exception) -> str:
    """What went wrong, for the page; an error that nobody foresaw is named by its type."""
    return str(error) if isinstance(error, (PocketGSError, OSError)) else f"{type(error).__name__}: {error}"
