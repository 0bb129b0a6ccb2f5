"""The queue: complete uploads are checked, and trained one at a time.

The queue is the captures in the states "checking" and "queued" themselves, so it is on disk with them.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from aiohttp import ClientSession

from pocketgs.errors import USER_ERROR, PocketGSError
from pocketgs.files.manifest import PRIVATE
from pocketgs.serve import child
from pocketgs.serve.checking import Check
from pocketgs.serve.entry import Entry, State
from pocketgs.serve.outcome import can_go_on, is_complete, plain_message
from pocketgs.serve.shelf import LOG, RESULT, THUMBNAIL, Shelf, input_of
from pocketgs.serve.thumbnail import show_rendering
from pocketgs.serve.training import Training


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
        self._work: dict[str, Check | Training] = {}
        self._held: set[str] = set()

    def running(self, identity: str) -> Training | None:
        """The run of a capture, if it is the one that goes on."""
        work = self._work.get(identity)
        return work if isinstance(work, Training) else None

    def waiting(self) -> list[Entry]:
        """The captures that wait to be trained, the next one first."""
        return self._in_state("queued")

    async def tell(self) -> None:
        """Look at the shelf again: something on it has changed."""
        async with self._news:
            self._news.notify_all()

    async def enqueue(self, entry: Entry) -> None:
        """Put a capture at the end of the queue.

        Raises:
            PocketGSError: that cannot be written down, such as on a full disk; nothing is changed.
        """
        self._shelf.change(replace(entry, state="queued", queued=time.time(), message=""))
        await self.tell()

    async def check_again(self, entry: Entry) -> None:
        """Check a capture again that was unusable, such as for want of room on the disk.

        Raises:
            PocketGSError: as `enqueue`.
        """
        self._shelf.change(replace(entry, state="checking", message=""))
        await self.tell()

    async def stop(self, entry: Entry) -> None:
        """Stop a capture's run, which keeps what was trained, if anything; or take it out of the queue.

        Raises:
            PocketGSError: as `enqueue`.
            RefusedError: as `Training.keep`.
        """
        run = self.running(entry.id)
        if run is None:
            if entry.state == "queued":
                self._shelf.change(replace(entry, state="stopped", anew=""))
            return
        if run.progress.get("iteration"):
            await run.keep()
        else:
            run.is_unwanted = True
            await self._end(entry.id, run, child.GRACE)

    @asynccontextmanager
    async def held(self, entry: Entry) -> AsyncIterator[None]:
        """End at once what is being done with a capture, and begin nothing with it while the block moves it.

        Its state is then the one before, so that what was ended begins again if the capture comes back.
        """
        self._held.add(entry.id)
        try:
            if work := self._work.get(entry.id):
                await self._end(entry.id, work, grace=0.0)
            yield
        finally:
            self._held.discard(entry.id)
            await self.tell()

    async def _end(self, identity: str, work: Check | Training, grace: float) -> None:
        """End a check or a run, even one that is just being started, and wait until the queue knows."""
        while self._work.get(identity) is work:
            await (work.end(grace) if isinstance(work, Training) else work.end())
            await asyncio.sleep(0.02)

    async def recover(self) -> None:
        """Take up again what a server that was killed has left half done, and end the run that it left behind."""
        for entry in list(self._shelf.entries.values()):
            place = self._shelf.place(entry)
            if entry.process:
                await asyncio.to_thread(child.end, entry.process, str(place / RESULT))
            if entry.state == "training":
                await self._note_end(entry, place)
            elif entry.state == "uploading" and self._shelf.has_all(entry):
                self._note(entry.id, state="checking")  # no more pieces come, which would tell that it is complete

    async def check_uploads(self) -> None:
        """Check complete uploads, until cancelled."""
        while True:
            entry = await self._next("checking")
            try:
                await self._check(entry)
            except Exception as error:  # whatever it is, other captures wait
                self._note(entry.id, state="unusable", message=_reason(error))
            await self.tell()

    async def train_queued(self) -> None:
        """Train what is queued, until cancelled: then the run that goes on is ended, and queued again."""
        async with ClientSession() as client:
            while True:
                entry = await self._next("queued")
                try:
                    await self._train(entry, client)
                except Exception as error:  # whatever it is, other captures wait
                    self._note(entry.id, state="failed", message=_reason(error), process=None)

    async def _next(self, state: State) -> Entry:
        """Wait for a capture in a state, and return the one that has waited longest."""

        def found() -> list[Entry]:
            return [entry for entry in self._in_state(state) if entry.id not in self._held]

        async with self._news:
            await self._news.wait_for(found)
        return found()[0]

    async def _check(self, entry: Entry) -> None:
        place, check = self._shelf.place(entry), Check()
        self._work[entry.id] = check
        try:
            status, said = await check.run(place, self._max_bytes, self._shelf.folder / PRIVATE)
        finally:
            del self._work[entry.id]
        if entry.id in self._held:
            return  # it was cut off: when the capture has come back, it is checked again
        if status == 0:
            self._note(entry.id, state="queued", queued=time.time())
            return
        message = said if status == USER_ERROR else f"checking it ended with status {status}"
        self._note(entry.id, state="unusable", message=plain_message(message, entry, place))

    async def _train(self, entry: Entry, client: ClientSession) -> None:
        effort, place, run = entry.anew or entry.effort, self._shelf.place(entry), Training(client)
        goes_on = not entry.anew and can_go_on(place / RESULT, entry.begun)
        # A checkpoint fits only the options that it was trained with, whatever the server's are by now.
        flags = entry.flags if goes_on else self._flags_of(effort)
        begun = entry.begun if goes_on else time.time()
        self._work[entry.id] = run
        try:
            self._note(entry.id, state="training", effort=effort, anew="", begun=begun, flags=flags, message="")
            resumed = ("--resume",) if goes_on else ()
            await run.start(input_of(place, entry), place / RESULT, (*flags, *resumed), self._shelf.folder / PRIVATE)
            self._note(entry.id, process=run.process)
            status = await run.finish(place / LOG)
            await self._conclude(replace(entry, begun=begun), status, run, place)
        except BaseException as error:
            await run.end()  # nobody follows it any more: it would train beside the next one
            if isinstance(error, asyncio.CancelledError):
                await self._note_end(replace(entry, begun=begun), place)
            raise
        finally:
            del self._work[entry.id]

    def _flags_of(self, effort: str) -> tuple[str, ...]:
        if effort not in self._flags:
            raise PocketGSError(f"effort {effort!r}, expected one of {', '.join(self._flags)}")
        return self._flags[effort]

    async def _conclude(self, entry: Entry, status: int, run: Training, place: Path) -> None:
        """Say how a run has ended."""
        # A run that was ended while it wrote its result has written all of it.
        if status == 0 or is_complete(place / RESULT, entry.begun):
            await self._keep_result(entry, place)
        elif entry.id in self._held:
            self._note(entry.id, state="queued", process=None)
        elif run.is_unwanted:
            self._note(entry.id, state="stopped", process=None)
        else:
            message = plain_message(run.last_words, entry, place)
            if status != USER_ERROR:
                message = f"training ended with status {status}; it said last: {message or 'nothing'}"
            self._note(entry.id, state="failed", message=message, process=None)

    async def _note_end(self, entry: Entry, place: Path) -> None:
        """Note that a run was ended with its server: it is queued again, unless its result was complete by then."""
        if is_complete(place / RESULT, entry.begun):
            await self._keep_result(entry, place)
        else:
            self._note(entry.id, state="queued", process=None)

    async def _keep_result(self, entry: Entry, place: Path) -> None:
        """Note that a capture is trained, and show its result."""
        with suppress(PocketGSError):
            await asyncio.to_thread(show_rendering, place / THUMBNAIL, place / RESULT)
        self._note(entry.id, state="trained", process=None)

    def _in_state(self, state: State) -> list[Entry]:
        """Captures in a state, the one that has waited longest first."""
        found = [entry for entry in self._shelf.entries.values() if entry.state == state]
        return sorted(found, key=lambda entry: entry.queued)

    def _note(self, identity: str, **changes: Any) -> None:
        """Change what is known of a capture, unless it was deleted. A full disk does not stop the queue."""
        if entry := self._shelf.entries.get(identity):
            with suppress(PocketGSError):
                self._shelf.save(replace(entry, **changes))


def _reason(error: Exception) -> str:
    """What went wrong, for the page; an error that nobody foresaw is named by its type."""
    return str(error) if isinstance(error, (PocketGSError, OSError)) else f"{type(error).__name__}: {error}"
