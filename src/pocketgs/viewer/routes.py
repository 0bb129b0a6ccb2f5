"""HTTP routes of the server."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import asdict, fields
from itertools import product
from pathlib import Path
from typing import get_args

from aiohttp import web

import pocketgs.gpu
import pocketgs.viewer
from pocketgs.files.opening import open_in_place
from pocketgs.splat.webgpu.passes import describe_rendering
from pocketgs.splat.webgpu.variant import DrawnShape, Variant, Weights
from pocketgs.viewer.access import Access
from pocketgs.viewer.commands import posted_command
from pocketgs.viewer.constants import MODULE, constants_module
from pocketgs.viewer.content import Content, View, jpeg
from pocketgs.viewer.following import Followers
from pocketgs.viewer.live import LiveRun
from pocketgs.viewer.news import Read
from pocketgs.viewer.responses import (
    TYPES,
    Handler,
    guarded_application,
    is_from_own_page,
    only_reading,
    refused,
    send_file,
    send_json,
    send_named,
)

PAGE = Path(pocketgs.viewer.__file__).parent / "page"
EXECUTOR = Path(pocketgs.gpu.__file__).parent


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
    appearances: tuple[DrawnShape, ...] = get_args(DrawnShape)
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
