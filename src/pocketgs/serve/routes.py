"""HTTP routes of the shelf's page. All are below the secret."""

from __future__ import annotations

import asyncio
import json
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from aiohttp import web

import pocketgs.site
from pocketgs.errors import PocketGSError
from pocketgs.files.opening import open_in_place
from pocketgs.serve.declaration import (
    FEWEST_PHOTOGRAPHS,
    MAX_TITLE,
    MOST_PHOTOGRAPHS,
    SUFFIXES,
    Bounds,
    checked_effort,
    clean_title,
)
from pocketgs.serve.downloads import SUFFIXES as DOWNLOAD_SUFFIXES
from pocketgs.serve.downloads import Downloads, disposition
from pocketgs.serve.entry import Entry, State
from pocketgs.serve.outcome import can_go_on
from pocketgs.serve.pages import Pages
from pocketgs.serve.pieces import MAX_PIECE
from pocketgs.serve.queue import Queue
from pocketgs.serve.refused import RefusedError, is_full, no_room
from pocketgs.serve.shelf import RESULT, THUMBNAIL, Shelf, delete_folders
from pocketgs.serve.shown import shown_deleted, shown_entry, shown_files
from pocketgs.serve.uploads import Uploads
from pocketgs.viewer.access import Access
from pocketgs.viewer.responses import (
    Handler,
    guarded_application,
    is_from_own_page,
    refused,
    send_file,
    send_json,
    send_named,
)
from pocketgs.viewer.routes import page_file

PAGE = Path(__file__).parent / "page"
CONTROLS = Path(pocketgs.site.__file__).parent / "page" / "controls"
SHARED = (CONTROLS / "focus.js", CONTROLS / "wake_lock.js")
"""Of the static site's page, the modules that this one uses."""

SECONDS_TO_SEND = 120.0
"""How long the body of a request may take to arrive."""


def shelf_application(access: Access, shelf: Shelf, queue: Queue, bounds: Bounds, effort: str) -> web.Application:
    """The web application of a shelf.

    Args:
        access: requirements for requests.
        shelf: of captures.
        queue: that trains them.
        bounds: of uploads.
        effort: that the page suggests.
    """
    uploads, pages = Uploads(shelf, queue, bounds), Pages(shelf, queue)
    routes = _Routes(shelf, queue, uploads, bounds, effort)
    known = guarded_application(access, _only_from_its_page, _explained, client_max_size=MAX_PIECE)
    known.on_startup.append(lambda _: pages.open())
    known.on_cleanup.append(lambda _: pages.close())
    get: dict[str, Handler] = {
        "/": routes.index,
        "/shelf/{name}": routes.page_file,
        "/page/{name:.+}": page_file,
        "/shelf.json": routes.shelf,
        "/captures/{id}/files.json": routes.files,
        "/captures/{id}/thumbnail.jpg": routes.thumbnail,
        "/captures/{id}/scene{suffix:\\.[a-z]{3}}": routes.download,
    }
    get |= {f"/captures/{{id}}/view{path}": handler for path, handler in pages.handlers().items()}
    post: dict[str, Handler] = {
        "/captures": routes.begin,
        "/captures/{id}/rename": routes.rename,
        "/captures/{id}/train": routes.train,
        "/captures/{id}/go-on": routes.go_on,
        "/captures/{id}/check": routes.check,
        "/captures/{id}/stop": routes.stop,
        "/captures/{id}/delete": routes.delete,
        "/captures/{id}/restore": routes.restore,
        "/trash/empty": routes.empty_trash,
    }
    post |= {f"/captures/{{id}}/view{path}": handler for path, handler in pages.command_handlers().items()}
    for path, handler in get.items():
        known.router.add_get("/{token}" + path, handler, allow_head=False)
    for path, handler in post.items():
        known.router.add_post("/{token}" + path, handler)
    known.router.add_put("/{token}/captures/{id}/files/{number:\\d{1,4}}", routes.put)
    return known


@web.middleware
async def _only_from_its_page(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Refuse changes that another site's page asks for, and bodies where none is expected."""
    if request.method == "GET":
        if request.body_exists:
            return refused(web.HTTPRequestEntityTooLarge(max_size=0, actual_size=request.content_length or 1))
    elif not is_from_own_page(request):
        return refused(web.HTTPForbidden())
    return await handler(request)


@web.middleware
async def _explained(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Answer what goes wrong with a sentence."""
    try:
        return await handler(request)
    except RefusedError as error:
        found = error
    except web.HTTPRequestEntityTooLarge:
        found = RefusedError(413, f"a request of more than {MAX_PIECE:,} bytes")
    except ConnectionError:  # the phone is gone
        raise
    except (PocketGSError, OSError) as error:
        said = (error.strerror if isinstance(error, OSError) else "") or str(error)
        found = no_room("nothing was changed") if is_full(error) else RefusedError(500, said)
    response = web.json_response({"error": found.sentence, **found.facts}, status=found.status)
    if found.status == 413:
        response.force_close()  # the rest of the request was not read
    return response


class _Routes:
    """One method per route."""

    def __init__(self, shelf: Shelf, queue: Queue, uploads: Uploads, bounds: Bounds, effort: str) -> None:
        self._shelf, self._queue, self._uploads = shelf, queue, uploads
        self._bounds, self._effort = bounds, effort
        self._downloads = Downloads()

    async def index(self, request: web.Request) -> web.StreamResponse:
        return await send_file(request, PAGE / "index.html")

    async def page_file(self, request: web.Request) -> web.StreamResponse:
        return await send_named(request, {path.name: path for path in (*PAGE.iterdir(), *SHARED)})

    async def shelf(self, _: web.Request) -> web.StreamResponse:
        captures = []
        for entry in sorted(self._shelf.entries.values(), key=lambda entry: -entry.created):
            with suppress(PocketGSError):  # its folder was taken away
                captures.append(shown_entry(self._shelf, self._queue, entry, self._uploads.last_piece(entry)))
        deleted = sorted(self._shelf.deleted.values(), key=lambda entry: -(entry.deleted or 0.0))
        return send_json(
            {
                "captures": captures,
                "deleted": [shown_deleted(entry) for entry in deleted],
                "bounds": {
                    "bytes": self._bounds.bytes,
                    "piece": MAX_PIECE,
                    "photographs": [FEWEST_PHOTOGRAPHS, MOST_PHOTOGRAPHS],
                    "title": MAX_TITLE,
                },
                "suffixes": {kind: sorted(suffixes) for kind, suffixes in SUFFIXES.items()},
                "efforts": list(self._bounds.efforts),
                "effort": self._effort,
            }
        )

    async def files(self, request: web.Request) -> web.StreamResponse:
        return send_json(shown_files(self._shelf, self._entry(request)))

    async def thumbnail(self, request: web.Request) -> web.StreamResponse:
        return await send_file(request, self._shelf.place(self._entry(request)) / THUMBNAIL, open_in_place)

    async def download(self, request: web.Request) -> web.StreamResponse:
        entry, suffix = self._entry(request), request.match_info["suffix"]
        if suffix not in DOWNLOAD_SUFFIXES:
            raise web.HTTPNotFound
        try:
            path = await self._downloads.scene_file(self._shelf.place(entry), suffix)
        except OSError as error:
            raise web.HTTPNotFound from error
        return await send_file(request, path, open_in_place, {"Content-Disposition": disposition(entry.title, suffix)})

    async def begin(self, request: web.Request) -> web.StreamResponse:
        entry = self._uploads.begin(await _json_of(request))
        return send_json({"id": entry.id, "names": [file.name for file in entry.files]})

    async def put(self, request: web.Request) -> web.StreamResponse:
        offset = request.query.get("offset", "")
        if not (offset.isascii() and offset.isdigit() and len(offset) < 16):
            raise RefusedError(400, "expected the piece's offset in bytes")
        identity, number = request.match_info["id"], int(request.match_info["number"])
        self._uploads.unfinished(identity, number)  # before the piece is read, which nobody may want any more
        piece = await _body_of(request)
        return send_json({"received": await self._uploads.put(identity, number, int(offset), piece)})

    async def rename(self, request: web.Request) -> web.StreamResponse:
        said = await _json_of(request)
        title = clean_title(said.get("title") if isinstance(said, dict) else None)
        self._shelf.change(replace(self._entry(request), title=title))
        return send_json({})

    async def train(self, request: web.Request) -> web.StreamResponse:
        said = await _json_of(request)
        effort = checked_effort(said.get("effort") if isinstance(said, dict) else None, self._bounds)
        entry = self._idle(request)
        await self._queue.enqueue(replace(entry, anew=effort))
        return send_json({})

    async def go_on(self, request: web.Request) -> web.StreamResponse:
        entry = self._idle(request)
        if not can_go_on(self._shelf.place(entry) / RESULT, entry.begun):
            raise RefusedError(409, f"{entry.title} has no unfinished run to go on with: train it again")
        await self._queue.enqueue(replace(entry, anew=""))
        return send_json({})

    async def check(self, request: web.Request) -> web.StreamResponse:
        await self._queue.check_again(self._in_state(request, "unusable"))
        return send_json({})

    async def stop(self, request: web.Request) -> web.StreamResponse:
        await self._queue.stop(self._entry(request))
        return send_json({})

    async def delete(self, request: web.Request) -> web.StreamResponse:
        async with self._queue.held(self._entry(request)):
            self._shelf.delete(self._entry(request))
        return send_json({})

    async def restore(self, request: web.Request) -> web.StreamResponse:
        entry = self._shelf.deleted.get(request.match_info["id"])
        if entry is None:
            raise RefusedError(404, "it is not in the trash any more")
        entry = self._shelf.restore(entry)
        await self._queue.tell()
        await self._uploads.complete(entry.id)  # its last piece may have been written while it was being deleted
        return send_json({})

    async def empty_trash(self, _: web.Request) -> web.StreamResponse:
        await asyncio.to_thread(delete_folders, self._shelf.empty_trash())
        return send_json({})

    def _entry(self, request: web.Request) -> Entry:
        entry = self._shelf.entries.get(request.match_info["id"])
        if entry is None:
            raise RefusedError(404, "no such capture: it was deleted")
        return entry

    def _idle(self, request: web.Request) -> Entry:
        """A capture that was checked, and neither waits nor trains."""
        return self._in_state(request, "trained", "failed", "stopped")

    def _in_state(self, request: web.Request, *states: State) -> Entry:
        entry = self._entry(request)
        if entry.state not in states:
            raise RefusedError(409, f"{entry.title} is {entry.state}")
        return entry


async def _body_of(request: web.Request) -> bytes:
    try:
        return await asyncio.wait_for(request.read(), SECONDS_TO_SEND)
    except asyncio.TimeoutError as error:
        raise RefusedError(408, "the rest of the request did not arrive") from error
    except web.RequestPayloadError as error:
        raise RefusedError(400, "the request's body is broken") from error


async def _json_of(request: web.Request) -> Any:
    try:
        return json.loads(await _body_of(request) or b"null")
    except (ValueError, RecursionError) as error:
        raise RefusedError(400, "expected JSON") from error
