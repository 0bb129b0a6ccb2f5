"""HTTP routes of the server."""

from __future__ import annotations

import asyncio
import json
import os
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import asdict, fields
from itertools import product
from pathlib import Path
from typing import BinaryIO, get_args

from aiohttp import web
from aiohttp.typedefs import Middleware

import pocketgs.gpu
import pocketgs.viewer
from pocketgs.files.opening import open_in_place
from pocketgs.splat.webgpu.passes import describe_rendering
from pocketgs.splat.webgpu.variant import Appearance, Variant, Weights
from pocketgs.viewer.access import Access, is_same_origin
from pocketgs.viewer.commands import posted_command
from pocketgs.viewer.constants import MODULE, constants_module
from pocketgs.viewer.content import Content, View, jpeg
from pocketgs.viewer.following import Followers
from pocketgs.viewer.live import LiveRun
from pocketgs.viewer.news import Read

PAGE = Path(pocketgs.viewer.__file__).parent / "page"
EXECUTOR = Path(pocketgs.gpu.__file__).parent

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


def application(access: Access, content: Callable[[], Content], run: LiveRun | None) -> web.Application:
    """The web application. All routes are below the token.

    Args:
        access: requirements for requests.
        content: returns the current content.
        run: to follow, or None.
    """

    async def current(_: web.Request) -> Content:
        return content()

    known = guarded_application(access, only_reading)
    handlers = page_handlers() | scene_handlers(current)
    if run:
        followers = Followers(run)
        known.on_shutdown.append(followers.dismiss)
        handlers = live_handlers(run, followers) | handlers
        known.router.add_post("/{token}/live", command_handler(run))
    for path, handler in handlers.items():
        known.router.add_get("/{token}" + path, handler, allow_head=False)
    return known


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


def page_handlers() -> dict[str, Handler]:
    """The page and what draws on it, the same for every scene: a handler for each path."""

    async def index(request: web.Request) -> web.StreamResponse:
        return await send_file(request, PAGE / "index.html")

    async def executor_file(request: web.Request) -> web.StreamResponse:
        return await send_named(request, {path.name: path for path in EXECUTOR.glob("*.js")})

    return {"/": index, "/page/{name:.+}": page_file, "/gpu/{name}": executor_file, "/passes.json": _passes}


async def page_file(request: web.Request) -> web.StreamResponse:
    """A module, style or image of the page."""
    if request.match_info["name"] == MODULE:
        return web.Response(text=constants_module(), headers={"Content-Type": TYPES[".js"]})
    files = (path for path in PAGE.rglob("*") if path.is_file())
    return await send_named(request, {path.relative_to(PAGE).as_posix(): path for path in files})


async def _passes(request: web.Request) -> web.StreamResponse:
    appearances: tuple[Appearance, ...] = get_args(Appearance)
    forms: tuple[Weights | None, ...] = (None, *get_args(Weights))
    asked = request.query.get("appearance", "splats"), request.query.get("weights")
    for appearance, weights in product(appearances, forms):
        if asked == (appearance, weights):
            return send_json(describe_rendering(Variant(appearance=appearance, weights=weights)).to_json())
    raise web.HTTPNotFound


def scene_handlers(content: Callable[[web.Request], Awaitable[Content]]) -> dict[str, Handler]:
    """What the page shows: a handler for each path.

    Args:
        content: returns the current content of the page that a request comes from.
    """

    async def viewer(request: web.Request) -> web.StreamResponse:
        try:
            return send_json((await content(request)).to_json())
        except OSError as error:
            raise web.HTTPNotFound from error

    async def view_of(request: web.Request) -> View:
        views, number = (await content(request)).views, int(request.match_info["number"])
        if number >= len(views):
            raise web.HTTPNotFound
        return views[number]

    async def photo(request: web.Request) -> web.StreamResponse:
        photo = (await view_of(request)).photo
        if photo is None:
            raise web.HTTPNotFound
        return web.Response(body=await asyncio.to_thread(jpeg, photo), content_type="image/jpeg")

    async def transients(request: web.Request) -> web.StreamResponse:
        picture = (await view_of(request)).transients
        if picture is None:
            raise web.HTTPNotFound
        return await send_file(request, picture, open_in_place)

    async def preview(request: web.Request) -> web.StreamResponse:
        return await send_named(request, (await content(request)).previews, open_in_place)

    async def scene(request: web.Request) -> web.StreamResponse:
        return await send_named(request, (await content(request)).scene_files, open_in_place)

    return {
        "/viewer.json": viewer,
        "/photos/{number:\\d{1,6}}.jpg": photo,
        "/transients/{number:\\d{1,6}}.png": transients,
        "/previews/{name}": preview,
        "/{name}": scene,
    }


def live_handlers(run: LiveRun, followers: Followers) -> dict[str, Handler]:
    """A run's news: a handler for each path."""

    async def live(request: web.Request) -> web.StreamResponse:
        if not is_from_own_page(request):
            return refused(web.HTTPForbidden())
        return await followers.follow(request)

    async def progress(_: web.Request) -> web.StreamResponse:
        return send_json(run.news.progress)

    async def news(request: web.Request) -> web.StreamResponse:
        run.news.note_poll()
        messages, read = run.news.since(_read_in(request))
        told = [message for message in messages if not isinstance(message, bytes)]
        return send_json({"read": asdict(read), "messages": told})

    async def snapshot(_: web.Request) -> web.StreamResponse:
        if not run.news.scene:
            raise web.HTTPNotFound
        return web.Response(body=run.news.scene)

    return {"/live": live, "/progress.json": progress, "/news.json": news, "/snapshot.spz": snapshot}


def _read_in(request: web.Request) -> Read:
    """What a page that polls has read, from the query; nothing where that says nothing."""
    try:
        return Read(**{kind.name: int(request.query.get(kind.name, 0)) for kind in fields(Read)})
    except ValueError as error:
        raise web.HTTPBadRequest from error


def command_handler(run: LiveRun) -> Handler:
    """Takes the commands of pages that have no WebSocket."""

    async def obey(request: web.Request) -> web.StreamResponse:
        if not is_from_own_page(request):
            return refused(web.HTTPForbidden())
        run.obey(await posted_command(request))
        return web.Response(status=204)

    return obey


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
