"""What the server does when one end of a request that it passes on is gone."""

from __future__ import annotations

import asyncio
import http.client
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import urlsplit

import pytest
from aiohttp import web

from pocketgs.serve.pages import Pages
from pocketgs.serve.shelf import Shelf
from pocketgs.serve.training import Training
from pocketgs.viewer.access import Access
from pocketgs.viewer.server import serving_application
from viewer.client import fetch


def application(access: Access, pages: Pages, ended: threading.Event) -> web.Application:
    """The pages of captures alone. It notes the end of each request."""

    @web.middleware
    async def watch(request: web.Request, handler: Any) -> web.StreamResponse:
        try:
            return await handler(request)
        finally:
            ended.set()

    served = web.Application(middlewares=[watch])
    served.on_startup.append(lambda _: pages.open())
    served.on_cleanup.append(lambda _: pages.close())
    for path, handler in pages.handlers().items():
        served.router.add_get(f"/{access.token}/captures/{{id}}/view{path}", handler)
    return served


def a_run(address: str) -> Any:
    return SimpleNamespace(address=address)


def endless(access: Access) -> web.Application:
    """The page of a run whose scene never ends."""

    async def scene(request: web.Request) -> web.StreamResponse:
        response = web.StreamResponse()
        await response.prepare(request)
        while True:
            await response.write(bytes(1 << 16))
            await asyncio.sleep(0)

    served = web.Application()
    served.router.add_get(f"/{access.token}/snapshot.spz", scene)
    return served


@pytest.fixture
def waited(monkeypatch: pytest.MonkeyPatch) -> list[Training]:
    """The runs whose end was waited for."""
    found: list[Training] = []

    async def until_ended(_: Pages, __: str, run: Training) -> None:
        found.append(run)

    monkeypatch.setattr(Pages, "_until_ended", until_ended)
    return found


def test_a_phone_that_leaves(folder: Path, waited: list[Training]) -> None:
    """Its request ends, whatever the run does."""
    ended = threading.Event()
    with serving_application(endless) as page:
        queue: Any = SimpleNamespace(running=lambda _: a_run(page.url))
        pages = Pages(Shelf(folder), queue)
        with serving_application(lambda access: application(access, pages, ended)) as served:
            parts = urlsplit(served.url)
            connection = http.client.HTTPConnection(str(parts.hostname), parts.port, timeout=20)
            connection.request("GET", f"{parts.path}captures/0/view/snapshot.spz")
            assert connection.getresponse().read(1 << 20)
            connection.close()
            assert ended.wait(20)
    assert waited == []


def test_a_page_that_is_gone(folder: Path, waited: list[Training]) -> None:
    """Once its run has ended, the result is asked."""
    with serving_application(endless) as page:
        pass
    run = a_run(page.url)
    queue: Any = SimpleNamespace(running=lambda _: run)
    pages = Pages(Shelf(folder), queue)
    with serving_application(lambda access: application(access, pages, threading.Event())) as served:
        assert fetch(served.url, "captures/0/view/snapshot.spz").status == 404
    assert waited == [run]
