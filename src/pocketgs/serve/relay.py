"""Passing requests on to the page of a run, which only this machine can reach."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from typing import Any

from aiohttp import (
    ClientConnectionError,
    ClientError,
    ClientResponse,
    ClientSession,
    ClientWebSocketResponse,
    WSMsgType,
    web,
)

from pocketgs.serve.training import Training
from pocketgs.viewer.commands import posted_command
from pocketgs.viewer.following import page_socket

CHUNK = 1 << 18


class PageGoneError(Exception):
    """A run's page cannot be reached any more."""


async def pass_on(request: web.Request, client: ClientSession, run: Training, path: str) -> web.StreamResponse:
    """Answer a GET with what the run's page answers.

    Args:
        request: from a phone.
        client: to ask with.
        run: whose page is asked.
        path: on that page.

    Raises:
        PageGoneError: the page is gone.
        ConnectionError: the phone is.
    """
    async with _asked(client, run, path) as answer:
        response = web.StreamResponse(status=answer.status, headers={"Content-Type": answer.content_type})
        response.content_length = answer.content_length
        await response.prepare(request)
        async for chunk in answer.content.iter_chunked(CHUNK):
            await response.write(chunk)
        await response.write_eof()
        return response


async def viewer_of(client: ClientSession, run: Training) -> dict[str, Any]:
    """The `viewer.json` of a run's page.

    Raises:
        PageGoneError: the page is gone.
    """
    async with _asked(client, run, "viewer.json") as answer:
        return dict(await answer.json())


@asynccontextmanager
async def _asked(client: ClientSession, run: Training, path: str) -> AsyncIterator[ClientResponse]:
    """What a run's page answers."""
    if run.address is None:
        raise web.HTTPServiceUnavailable
    try:
        answer = await client.get(f"{run.address}{path}")
    except ClientConnectionError as error:  # not those of the phone's connection, which have the same type
        raise PageGoneError from error
    async with answer:
        yield answer


async def follow(request: web.Request, run: Training) -> web.WebSocketResponse:
    """Connect a phone's WebSocket with that of the run's page, until one of them closes."""
    try:
        source = await run.follow()
    except (ClientError, OSError) as error:
        raise web.HTTPServiceUnavailable from error
    async with source:
        page = page_socket()
        await page.prepare(request)
        ways = {asyncio.create_task(_news(source, page)), asyncio.create_task(_commands(page, source))}
        _, rest = await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
        for way in rest:
            way.cancel()
        await asyncio.gather(*ways, return_exceptions=True)
        await page.close()
        return page


async def obey(request: web.Request, run: Training) -> web.Response:
    """Pass the command in a phone's request on to the run's page."""
    command = await posted_command(request)
    try:
        await run.obey(command)
    except (ClientError, OSError, asyncio.TimeoutError) as error:
        raise web.HTTPServiceUnavailable from error
    return web.Response(status=204)


async def _news(source: ClientWebSocketResponse, page: web.WebSocketResponse) -> None:
    with suppress(ConnectionError):
        async for message in source:
            if message.type is WSMsgType.TEXT:
                await page.send_str(message.data)
            elif message.type is WSMsgType.BINARY:
                await page.send_bytes(message.data)


async def _commands(page: web.WebSocketResponse, source: ClientWebSocketResponse) -> None:
    with suppress(ConnectionError):
        async for message in page:
            if message.type is not WSMsgType.TEXT:
                return
            await source.send_str(message.data)
