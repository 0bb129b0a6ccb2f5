"""What every route of the servers shares: guards, headers, and sending files and JSON."""

from __future__ import annotations

import asyncio
import json
import os
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import BinaryIO

from aiohttp import web
from aiohttp.typedefs import Middleware

from pocketgs.viewer.access import Access, is_same_origin

CHUNK = 1 << 18
TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".jpg": "image/jpeg",
}
"""Content types by suffix; the system's table may be wrong. Everything else is a stream of bytes."""

# The page creates images itself, so blob: and data: are allowed for images.
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' blob: data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": POLICY,
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",  # the address contains the secret
    "Server": "pocketgs",
    "X-Content-Type-Options": "nosniff",
}

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]
Opener = Callable[[Path], BinaryIO]


def guarded_application(access: Access, *middlewares: Middleware, client_max_size: int = 1 << 20) -> web.Application:
    """An application without routes: it refuses requests without the secret, and adds `HEADERS` to every response.

    Args:
        access: requirements for requests.
        middlewares: further checks, after that of the secret.
        client_max_size: the largest body that a handler may read, in bytes.
    """
    known = web.Application(middlewares=[_guard(access), *middlewares], client_max_size=client_max_size)
    known.on_response_prepare.append(_add_headers)
    return known


def _guard(access: Access) -> Middleware:
    @web.middleware
    async def guard(request: web.Request, handler: Handler) -> web.StreamResponse:
        if not access.serves_host(request.host) or not access.opens(request.path):
            return refused(web.HTTPForbidden())
        return await handler(request)

    return guard


@web.middleware
async def only_reading(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Refuse everything but GET without a body, and what a route takes besides."""
    if request.method != "GET":
        if request.match_info.route.method == request.method:
            return await handler(request)
        return refused(web.HTTPMethodNotAllowed(request.method, ["GET"]))
    if request.body_exists:
        return refused(web.HTTPRequestEntityTooLarge(max_size=0, actual_size=request.content_length or 1))
    return await handler(request)


def is_from_own_page(request: web.Request) -> bool:
    """Whether a browser says that a page of this server makes a request."""
    return is_same_origin(request.headers.get("Origin"), request.scheme, request.host)


def refused(reason: web.HTTPException) -> web.Response:
    """A response with the reason only; the rest of the request is not read."""
    response = web.Response(status=reason.status, text=reason.reason)
    response.force_close()
    return response


async def _add_headers(_: web.Request, response: web.StreamResponse) -> None:
    response.headers.update(HEADERS)


def send_json(content: object) -> web.Response:
    """A response with JSON. NaN and infinity raise a ValueError: JSON has none, and no page could read them."""
    return web.Response(text=json.dumps(content, allow_nan=False), content_type="application/json")


def _open(path: Path) -> BinaryIO:
    """A file of this package."""
    return path.open("rb")


async def send_named(request: web.Request, files: Mapping[str, Path], opened: Opener = _open) -> web.StreamResponse:
    """Serve a file by its name in a mapping: no path is ever built from a request."""
    path = files.get(request.match_info["name"])
    if path is None:
        raise web.HTTPNotFound
    return await send_file(request, path, opened)


async def send_file(
    request: web.Request, path: Path, opened: Opener = _open, headers: Mapping[str, str] | None = None
) -> web.StreamResponse:
    """Serve a file as it is; aiohttp's FileResponse would serve a compressed file beside it instead.

    Args:
        request: to answer.
        path: of the file.
        opened: opens it.
        headers: of the response, beside its type.
    """
    try:
        file = await asyncio.to_thread(opened, path)
    except OSError as error:
        raise web.HTTPNotFound from error
    with file:
        left = os.fstat(file.fileno()).st_size
        kind = TYPES.get(path.suffix, "application/octet-stream")
        response = web.StreamResponse(headers={"Content-Type": kind, **(headers or {})})
        response.content_length = left
        await response.prepare(request)
        while left and (chunk := await asyncio.to_thread(file.read, min(CHUNK, left))):
            await response.write(chunk)
            left -= len(chunk)
        if left:  # the file was truncated meanwhile, so the response must fail
            response.force_close()
            raise ConnectionResetError(f"{path}: {left} bytes are gone")
        await response.write_eof()
    return response
