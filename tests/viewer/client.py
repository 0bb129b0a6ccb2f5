"""HTTP and WebSocket clients of the page's server."""

from __future__ import annotations

import http.client
import json
import ssl
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

from aiohttp import ClientSession, ClientWebSocketResponse, WSMsgType


@dataclass(frozen=True)
class Answer:
    """A server's response."""

    status: int
    headers: Mapping[str, str]
    body: bytes

    @property
    def json(self) -> Any:
        return json.loads(self.body)


def fetch(
    url: str,
    path: str = "",
    *,
    method: str = "GET",
    headers: Mapping[str, str] | None = None,
    body: bytes | None = None,
    trust: ssl.SSLContext | None = None,
) -> Answer:
    """Request a path below a URL, or an absolute one, without normalising it as browsers do."""
    parts = urlsplit(url)
    assert parts.hostname
    if parts.scheme == "https":
        connection = http.client.HTTPSConnection(parts.hostname, parts.port, timeout=20, context=trust)
    else:
        connection = http.client.HTTPConnection(parts.hostname, parts.port, timeout=20)
    connection.request(method, path if path.startswith("/") else parts.path + path, body, headers or {})
    answer = connection.getresponse()
    found = Answer(answer.status, dict(answer.getheaders()), answer.read())
    connection.close()
    return found


def origin_of(url: str) -> str:
    """The page's origin, as browsers send it."""
    parts = urlsplit(url)
    return f"{parts.scheme}://{parts.netloc}"


@dataclass
class Follower:
    """The client end of the WebSocket, and the messages it has received."""

    socket: ClientWebSocketResponse
    progress: list[dict[str, Any]] = field(default_factory=list)
    viewers: list[dict[str, Any]] = field(default_factory=list)
    scenes: list[tuple[dict[str, Any], bytes]] = field(default_factory=list)

    @property
    def samples(self) -> list[dict[str, Any]]:
        """The curves, as a page puts them together."""
        return [sample for progress in self.progress for sample in progress["samples"]]

    async def say(self, kind: str) -> None:
        await self.socket.send_str(json.dumps({"type": kind}))

    async def read(self) -> bool:
        """Receive one message; returns whether there was one."""
        message = await self.socket.receive(timeout=30)
        if message.type is not WSMsgType.TEXT:
            return False
        content = json.loads(message.data)
        if content["type"] == "progress":
            self.progress.append(content)
        elif content["type"] == "cameras":
            self.viewers.append(content["viewer"])
        else:
            assert content["type"] == "scene"
            encoded = await self.socket.receive_bytes(timeout=30)
            assert len(encoded) == content["bytes"]
            self.scenes.append((content, encoded))
        return True

    async def until(self, **wanted: object) -> dict[str, Any]:
        """Read on until progress has these fields, and give it."""
        while await self.read():
            if self.progress and wanted.items() <= self.progress[-1].items():
                return self.progress[-1]
        raise AssertionError(f"the server closed with {self.socket.close_code} before {wanted}")


@asynccontextmanager
async def following(url: str) -> AsyncIterator[Follower]:
    """Follow the run of a page, as the page itself does."""
    async with (
        ClientSession() as session,
        session.ws_connect(f"{url}live", origin=origin_of(url), max_msg_size=0) as socket,
    ):
        yield Follower(socket)
