"""The viewer's page for each capture: of its result, or, while it trains, the page of the run."""

from __future__ import annotations

import asyncio
import time
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from aiohttp import ClientSession, ClientTimeout, web

from pocketgs.errors import PocketGSError
from pocketgs.results.folder import RECORD, SCENE
from pocketgs.scene.formats import read_scene
from pocketgs.serve import relay
from pocketgs.serve.queue import Queue
from pocketgs.serve.shelf import RESULT, Shelf
from pocketgs.serve.training import SECONDS_TO_END, Training
from pocketgs.viewer.content import Content
from pocketgs.viewer.responses import Handler, is_from_own_page, refused, send_json
from pocketgs.viewer.routes import page_handlers, scene_handlers
from pocketgs.viewer.scene_content import scene_content

SHOWN_AT_ONCE = 8
SECONDS_BETWEEN_LOOKS = 0.1
"""Seconds between two checks whether a run that has closed its page has ended."""

WITHOUT_END = ClientTimeout(total=None, sock_connect=10.0)
"""However long it takes: a phone far from its router receives a scene at its own pace."""


class Pages:
    """The pages of a shelf's captures.

    Args:
        shelf: with the captures.
        queue: knows which of them trains.
    """

    def __init__(self, shelf: Shelf, queue: Queue) -> None:
        self._shelf, self._queue = shelf, queue
        self._client: ClientSession | None = None

    def handlers(self) -> dict[str, Handler]:
        """A handler for each path below that of the page; requests have the capture's `id`."""
        of_result = scene_handlers(self._content)
        followed = {path: self._or_from_run(handler) for path, handler in of_result.items()}
        return {**page_handlers(), "/live": self._live, **followed}

    def command_handlers(self) -> dict[str, Handler]:
        """Likewise for what takes commands."""
        return {"/live": self._obey}

    async def open(self) -> None:
        """Prepare for asking runs' pages; call it on the event loop."""
        self._client = ClientSession(timeout=WITHOUT_END)

    async def close(self) -> None:
        """Close what `open` has opened."""
        if self._client:
            await self._client.close()

    async def _content(self, request: web.Request) -> Content:
        entry = self._shelf.entries.get(request.match_info["id"])
        if entry is None:
            raise web.HTTPNotFound
        result = self._shelf.place(entry) / RESULT
        try:
            written = (result / RECORD).stat().st_mtime_ns
            content = await asyncio.to_thread(_content_of, result, written)
        except (PocketGSError, OSError) as error:
            raise web.HTTPNotFound from error
        return replace(content, title=entry.title)

    def _or_from_run(self, of_result: Handler) -> Handler:
        async def answer(request: web.Request) -> web.StreamResponse:
            run = self._queue.running(request.match_info["id"])
            if run is None:
                return await of_result(request)
            try:
                return await self._from_run(request, run)
            except relay.PageGoneError:  # it has just ended; what it showed last is in its result
                await self._until_ended(request.match_info["id"], run)
                return await of_result(request)

        return answer

    async def _from_run(self, request: web.Request, run: Training) -> web.StreamResponse:
        assert self._client
        path = request.raw_path.partition("/view/")[2]
        if path == "viewer.json":
            title = self._shelf.entries[request.match_info["id"]].title
            return send_json({**await relay.viewer_of(self._client, run), "title": title})
        return await relay.pass_on(request, self._client, run, path)

    async def _until_ended(self, identity: str, run: Training) -> None:
        deadline = time.monotonic() + SECONDS_TO_END
        while self._queue.running(identity) is run and time.monotonic() < deadline:
            await asyncio.sleep(SECONDS_BETWEEN_LOOKS)

    async def _live(self, request: web.Request) -> web.StreamResponse:
        run = self._run(request)
        if not is_from_own_page(request):
            return refused(web.HTTPForbidden())
        return await relay.follow(request, run)

    async def _obey(self, request: web.Request) -> web.StreamResponse:
        return await relay.obey(request, self._run(request))

    def _run(self, request: web.Request) -> Training:
        run = self._queue.running(request.match_info["id"])
        if run is None:
            raise web.HTTPNotFound
        return run


@lru_cache(SHOWN_AT_ONCE)
def _content_of(result: Path, written: int) -> Content:
    """What the page shows of a result; kept until the next one is written."""
    scene = result / SCENE
    return scene_content("", scene, read_scene(scene), result, None)
