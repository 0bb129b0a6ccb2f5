"""The WebSocket by which a page follows a run."""

from __future__ import annotations

import asyncio
import json
from contextlib import suppress
from typing import get_args

from aiohttp import WSCloseCode, WSMessage, WSMsgType, web

from pocketgs.viewer.live import Command, LiveRun
from pocketgs.viewer.news import Read

SECONDS_BETWEEN_LOOKS = 0.1
"""How often a page's task looks for news, so that the training thread need not wake it, nor wait for it."""

SECONDS_BETWEEN_PINGS = 20.0
SECONDS_TO_CLOSE = 1.0
SECONDS_TO_DISMISS = 2.0
MAX_COMMAND_BYTES = 256
"""Bytes of a message from a page."""


class Followers:
    """The pages that follow a run."""

    def __init__(self, run: LiveRun) -> None:
        self._run = run
        self._tellers: set[asyncio.Task[None]] = set()
        self._is_over = False

    async def follow(self, request: web.Request) -> web.WebSocketResponse:
        """Tell a page of the run, and the run what the page asks for, until the page goes or breaks the protocol."""
        page = web.WebSocketResponse(
            max_msg_size=MAX_COMMAND_BYTES, heartbeat=SECONDS_BETWEEN_PINGS, timeout=SECONDS_TO_CLOSE, compress=False
        )
        await page.prepare(request)
        teller = asyncio.create_task(self._tell(page))
        self._tellers.add(teller)
        try:
            async for message in page:
                command = _command(message)
                if command is None:
                    await page.close(code=WSCloseCode.POLICY_VIOLATION)
                    break
                self._run.obey(command)
        finally:
            self._tellers.discard(teller)
            teller.cancel()
        return page

    async def dismiss(self, _: web.Application) -> None:
        """Tell the pages what is left to tell, and that the server ends; one that does not listen is left behind."""
        self._is_over = True
        if self._tellers:
            await asyncio.wait(self._tellers, timeout=SECONDS_TO_DISMISS)

    async def _tell(self, page: web.WebSocketResponse) -> None:
        """Send what is new, as fast as the page takes it."""
        news, read, is_last = self._run.news, Read(), False
        with suppress(ConnectionError), news.reading():
            while not is_last and not page.closed:
                is_last = self._is_over
                messages, read = news.since(read)
                for message in messages:
                    await (page.send_str(message) if isinstance(message, str) else page.send_bytes(message))
                await asyncio.sleep(SECONDS_BETWEEN_LOOKS)
            await page.close(code=WSCloseCode.GOING_AWAY)


def _command(message: WSMessage) -> Command | None:
    """What a page asks for, or None if it is nothing that the protocol knows."""
    if message.type is not WSMsgType.TEXT:
        return None
    try:
        content = json.loads(message.data)
    except (ValueError, RecursionError):
        return None
    known: tuple[Command, ...] = get_args(Command)
    return next((command for command in known if content == {"type": command}), None)
