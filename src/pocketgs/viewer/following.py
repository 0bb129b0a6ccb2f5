"""The WebSocket through which a page follows a run."""

from __future__ import annotations

import asyncio
from contextlib import suppress

from aiohttp import WSCloseCode, WSMsgType, web

from pocketgs.viewer.commands import MAX_COMMAND_BYTES, command_in
from pocketgs.viewer.live import LiveRun
from pocketgs.viewer.news import Read

SECONDS_BETWEEN_LOOKS = 0.1
"""Polling interval of a page's task, so that the training thread need not wake it or wait for it."""

SECONDS_BETWEEN_PINGS = 20.0
SECONDS_TO_CLOSE = 1.0
SECONDS_TO_DISMISS = 2.0


def page_socket() -> web.WebSocketResponse:
    """A WebSocket to a page, which sends short commands."""
    return web.WebSocketResponse(
        max_msg_size=MAX_COMMAND_BYTES, heartbeat=SECONDS_BETWEEN_PINGS, timeout=SECONDS_TO_CLOSE, compress=False
    )


class Followers:
    """The pages that follow a run."""

    def __init__(self, run: LiveRun) -> None:
        self._run = run
        self._tellers: set[asyncio.Task[None]] = set()
        self._is_over = False

    async def follow(self, request: web.Request) -> web.WebSocketResponse:
        """Send a page the run's news and pass its commands to the run, until it leaves or violates the protocol."""
        page = page_socket()
        await page.prepare(request)
        teller = asyncio.create_task(self._tell(page))
        self._tellers.add(teller)
        try:
            async for message in page:
                command = command_in(message.data) if message.type is WSMsgType.TEXT else None
                if command is None:
                    await page.close(code=WSCloseCode.POLICY_VIOLATION)
                    break
                self._run.obey(command)
        finally:
            self._tellers.discard(teller)
            teller.cancel()
        return page

    async def dismiss(self, _: web.Application) -> None:
        """Send the remaining news and close; pages that do not respond are dropped."""
        self._is_over = True
        if self._tellers:
            await asyncio.wait(self._tellers, timeout=SECONDS_TO_DISMISS)

    async def _tell(self, page: web.WebSocketResponse) -> None:
        """Send news as fast as the page accepts it."""
        news, read, is_last = self._run.news, Read(), False
        with suppress(ConnectionError), news.reading():
            while not is_last and not page.closed:
                is_last = self._is_over
                messages, read = news.since(read)
                for message in messages:
                    await (page.send_bytes(message) if isinstance(message, bytes) else page.send_json(message))
                await asyncio.sleep(SECONDS_BETWEEN_LOOKS)
            await page.close(code=WSCloseCode.GOING_AWAY)
