"""A run: `pocketgs train` as a child process, with its page, from which the server learns how far it is."""

from __future__ import annotations

import asyncio
import os
import re
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

from aiohttp import ClientError, ClientSession, ClientTimeout, ClientWebSocketResponse

from pocketgs.serve import child
from pocketgs.serve.refused import RefusedError
from pocketgs.viewer.commands import command_message
from pocketgs.viewer.live import Command

ADDRESS = re.compile(r"page at (http://127\.0\.0\.1:\d+/[\w-]+/)")
SECONDS_BETWEEN_LOOKS = 1.0
ANSWER = ClientTimeout(total=10.0)
SECONDS_TO_END = 10.0
"""How long a run may take to end after it has closed its page."""


class Training:
    """A `pocketgs train` that goes on.

    Args:
        client: to ask its page with.

    Attributes:
        is_unwanted: whether the user has stopped it.
    """

    def __init__(self, client: ClientSession) -> None:
        self._client = client
        self._child: asyncio.subprocess.Process | None = None
        self._result = Path()
        self.address: str | None = None
        self.progress: dict[str, Any] = {"stage": "starting", "iteration": 0}
        self.last_words = ""
        self.is_unwanted = False

    async def start(self, capture: Path, result: Path, flags: Sequence[str], folder: Path) -> None:
        """Start the run.

        Args:
            capture: what to train.
            result: folder for the result.
            flags: of `pocketgs train`.
            folder: to work in.
        """
        page = ("--view", "--no-open", "--no-wait")
        arguments = ("pocketgs", "train", str(capture), "--output", str(result), *page, *flags)
        self._result = result
        self._child = await child.start(arguments, folder)

    @property
    def process(self) -> int | None:
        """Number of the process; None before it is started."""
        return self._child.pid if self._child else None

    async def finish(self, log: Path) -> int:
        """Wait for the end of the run, and return its exit status.

        Args:
            log: file for what it prints.
        """
        assert self._child
        looking = asyncio.create_task(self._look())
        try:
            await self._read(log)
            return await self._child.wait()
        finally:
            looking.cancel()

    async def keep(self) -> None:
        """Stop the run after its current step, as Ctrl-C does; it keeps what was trained.

        Raises:
            RefusedError: it goes on, and does not answer.
        """
        try:
            await self.obey("stop")
        except (ClientError, OSError, asyncio.TimeoutError) as error:
            if not await self.ends_within(SECONDS_TO_END):
                raise RefusedError(503, "the run does not answer: try again") from error
        else:
            self.is_unwanted = True

    async def end(self, grace: float = child.GRACE) -> None:
        """End the run: as Ctrl-C does, or, after so many seconds, by force."""
        if self._child and self._child.returncode is None:
            await asyncio.to_thread(child.end, self._child.pid, str(self._result), grace)
            await self.ends_within(child.GRACE)

    async def ends_within(self, seconds: float) -> bool:
        """Whether the process of the run ends in time."""
        assert self._child
        with suppress(asyncio.TimeoutError):
            await asyncio.wait_for(self._child.wait(), seconds)
        return self._child.returncode is not None

    async def follow(self) -> ClientWebSocketResponse[Any]:
        """Open a WebSocket to the run's page.

        Raises:
            ConnectionError: it has none yet.
            ClientError: it does not answer.
        """
        address, origin = self._live()
        return await self._client.ws_connect(address, origin=origin, max_msg_size=0)

    async def obey(self, command: Command) -> None:
        """Pass a page's command on to the run's page.

        Raises:
            ConnectionError: it has none yet.
            ClientError: it does not answer, or refuses.
            TimeoutError: it takes too long.
        """
        address, origin = self._live()
        async with self._client.post(
            address,
            data=command_message(command),
            headers={"Origin": origin},
            timeout=ANSWER,
            raise_for_status=True,
        ):
            pass

    def _live(self) -> tuple[str, str]:
        """Where the run's page takes commands, and the page's origin.

        Raises:
            ConnectionError: it has none yet.
        """
        if self.address is None:
            raise ConnectionError("the run has no page yet")
        return f"{self.address}live", self.address.rsplit("/", 2)[0]

    async def _read(self, log: Path) -> None:
        """Write what the run prints to a file, except the address of its page."""
        assert self._child
        assert self._child.stdout
        with _opened(log) as file:
            while line := await _line(self._child.stdout):
                text = line.decode(errors="replace").strip()
                if found := ADDRESS.match(text):
                    self.address = found[1]
                elif text:
                    self.last_words = text
                    with suppress(OSError):  # a full disk must not end a run that may need no more of it
                        file.write(line)

    async def _look(self) -> None:
        """Ask the run's page how far it is, again and again."""
        while True:
            await asyncio.sleep(SECONDS_BETWEEN_LOOKS)
            if self.address:
                with suppress(ClientError, OSError, asyncio.TimeoutError, ValueError):
                    async with self._client.get(f"{self.address}progress.json", timeout=ANSWER) as answer:
                        self.progress = await answer.json()


def _opened(log: Path) -> BinaryIO:
    """A file to write to; one that keeps nothing if it cannot be opened, since no run must end for its log."""
    try:
        return log.open("wb", buffering=0)
    except OSError:
        return open(os.devnull, "wb", buffering=0)


async def _line(stream: asyncio.StreamReader) -> bytes:
    """The next line, or as much of it as fits in the stream's buffer; empty at the end."""
    try:
        return await stream.readuntil(b"\n")
    except asyncio.IncompleteReadError as end:
        return end.partial
    except asyncio.LimitOverrunError as found:
        return await stream.read(max(found.consumed, 1))
