"""The commands that pages send to a run, over a WebSocket or in requests."""

from __future__ import annotations

import asyncio
import json
from typing import get_args

from aiohttp import web

from pocketgs.viewer.live import Command

MAX_COMMAND_BYTES = 256
"""Maximum size of a message from a page, in bytes."""


def command_message(command: Command) -> str:
    """What a page sends."""
    return json.dumps({"type": command})


def command_in(message: str | bytes) -> Command | None:
    """The command in a message, or None if it is unknown."""
    try:
        content = json.loads(message)
    except (ValueError, RecursionError):
        return None
    known: tuple[Command, ...] = get_args(Command)
    return next((command for command in known if content == {"type": command}), None)


async def posted_command(request: web.Request) -> Command:
    """The command in a request's body, of which no more is read than a command can have.

    Raises:
        HTTPRequestEntityTooLarge: the body is longer.
        HTTPBadRequest: it is no command.
    """
    try:
        await request.content.readexactly(MAX_COMMAND_BYTES + 1)
    except asyncio.IncompleteReadError as end:
        command = command_in(end.partial)
        if command is None:
            raise web.HTTPBadRequest from end
        return command
    except web.RequestPayloadError as error:  # packed, or in pieces, in a way that is broken
        raise web.HTTPBadRequest from error
    raise web.HTTPRequestEntityTooLarge(MAX_COMMAND_BYTES, request.content_length or MAX_COMMAND_BYTES + 1)
