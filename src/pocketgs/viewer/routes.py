"""HTTP routes of the server."""

from __future__ import annotations

import asyncio
import json
import os
from collections.abc import Awaitable, Callable, Mapping
from itertools import product
from pathlib import Path
from typing import BinaryIO, get_args

from aiohttp import web
from aiohttp.typedefs import Middleware

import pocketgs.gpu
import pocketgs.viewer
from pocketgs.files.opening import open_in_place
from pocketgs.splat.webgpu.passes import Appearance, Variant, Weights, describe
from pocketgs.viewer.access import Access, is_same_origin
from pocketgs.viewer.content import Content, jpeg
from pocketgs.viewer.following import Followers
from pocketgs.viewer.live import LiveRun

PAGE = Path(pocketgs.viewer.__file__).parent / "page"
EXECUTOR = Path(pocketgs.gpu.__file__).parent

CHUNK = 1 << 18
TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
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


def application(access: Access, content: Callable[[], Content], run: LiveRun | None) -> web.Application:
    """The web application. All routes are below the token.

    Args:
        access: requirements for requests.
        content: returns the current content.
        run: to follow, or None.
    """
    routes = _Routes(content, run)
    known = web.Application(middlewares=[_guard(access)])
    known.on_response_prepare.append(_add_headers)
    if routes.followers:
        known.on_shutdown.append(routes.followers.dismiss)
    handlers: dict[str, Handler] = {
        "/": routes.index,
        "/page/{name:.+}": routes.page_file,
        "/gpu/{name}": routes.executor_file,
        "/passes.json": routes.passes,
        "/viewer.json": routes.viewer,
        "/photos/{number:\\d{1,6}}.jpg": routes.photo,
        "/previews/{name}": routes.preview,
        "/live": routes.live,
        "/{name}": routes.scene,
    }
    for path, handler in handlers.items():
        known.router.add_get("/{token}" + path, handler, allow_head=False)
    return known


def _guard(access: Access) -> Middleware:
    @web.middleware
    async def guard(request: web.Request, handler: Handler) -> web.StreamResponse:
        if not access.serves_host(request.host) or not access.opens(request.path):
            return _refused(web.HTTPForbidden())
        if request.method != "GET":
            return _refused(web.HTTPMethodNotAllowed(request.method, ["GET"]))
        if request.body_exists:
            return _refused(web.HTTPRequestEntityTooLarge(max_size=0, actual_size=request.content_length or 1))
        return await handler(request)

    return guard


def _refused(reason: web.HTTPException) -> web.Response:
    """A response with the reason only; the rest of the request is not read."""
    response = web.Response(status=reason.status, text=reason.reason)
    response.force_close()
    return response


async def _add_headers(_: web.Request, response: web.StreamResponse) -> None:
    response.headers.update(HEADERS)


class _Routes:
    """One method per route."""

    def __init__(self, content: Callable[[], Content], run: LiveRun | None) -> None:
        self._content = content
        self.followers = Followers(run) if run else None

    async def index(self, request: web.Request) -> web.StreamResponse:
        return await _file(request, PAGE / "index.html")

    async def page_file(self, request: web.Request) -> web.StreamResponse:
        files = (path for path in PAGE.rglob("*") if path.is_file())
        return await _file_named(request, {path.relative_to(PAGE).as_posix(): path for path in files})

    async def executor_file(self, request: web.Request) -> web.StreamResponse:
        return await _file_named(request, {path.name: path for path in EXECUTOR.glob("*.js")})

    async def passes(self, request: web.Request) -> web.StreamResponse:
        appearances: tuple[Appearance, ...] = get_args(Appearance)
        forms: tuple[Weights | None, ...] = (None, *get_args(Weights))
        asked = request.query.get("appearance", "splats"), request.query.get("weights")
        for appearance, weights in product(appearances, forms):
            if asked == (appearance, weights):
                return _json(describe(Variant(appearance=appearance, weights=weights), training=False).to_json())
        raise web.HTTPNotFound

    async def viewer(self, _: web.Request) -> web.StreamResponse:
        try:
            return _json(self._content().to_json())
        except OSError as error:
            raise web.HTTPNotFound from error

    async def photo(self, request: web.Request) -> web.StreamResponse:
        views, number = self._content().views, int(request.match_info["number"])
        photo = views[number].photo if number < len(views) else None
        if photo is None:
            raise web.HTTPNotFound
        return web.Response(body=await asyncio.to_thread(jpeg, photo), content_type="image/jpeg")

    async def preview(self, request: web.Request) -> web.StreamResponse:
        return await _file_named(request, self._content().previews, open_in_place)

    async def scene(self, request: web.Request) -> web.StreamResponse:
        return await _file_named(request, self._content().scene_files, open_in_place)

    async def live(self, request: web.Request) -> web.StreamResponse:
        if self.followers is None:
            raise web.HTTPNotFound
        if not is_same_origin(request.headers.get("Origin"), request.scheme, request.host):
            return _refused(web.HTTPForbidden())
        return await self.followers.follow(request)


def _json(content: object) -> web.Response:
    return web.Response(text=json.dumps(content), content_type="application/json")


def _open(path: Path) -> BinaryIO:
    """A file of this package."""
    return path.open("rb")


async def _file_named(request: web.Request, files: Mapping[str, Path], opened: Opener = _open) -> web.StreamResponse:
    """Serve a file by its name in a mapping: no path is ever built from a request."""
    path = files.get(request.match_info["name"])
    if path is None:
        raise web.HTTPNotFound
    return await _file(request, path, opened)


async def _file(request: web.Request, path: Path, opened: Opener = _open) -> web.StreamResponse:
    """Serve a file as it is; aiohttp's FileResponse would serve a compressed file beside it instead."""
    try:
        file = await asyncio.to_thread(opened, path)
    except OSError as error:
        raise web.HTTPNotFound from error
    with file:
        left = os.fstat(file.fileno()).st_size
        response = web.StreamResponse(headers={"Content-Type": TYPES.get(path.suffix, "application/octet-stream")})
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
