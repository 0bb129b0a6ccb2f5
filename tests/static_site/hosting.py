"""A static host, which knows what it was asked for, and changes to what it serves."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from playwright.sync_api import BrowserContext, Route


@dataclass
class Host:
    """A server of the site: its address, and the requested paths, in order."""

    address: str = ""
    asked: list[str] = field(default_factory=list)


class _Handler(SimpleHTTPRequestHandler):
    def __init__(self, *args: Any, host: Host, **options: Any) -> None:
        self.host = host
        super().__init__(*args, **options)

    def log_message(self, *_: object) -> None:
        self.host.asked.append(self.path)


@contextmanager
def hosting(folder: Path) -> Iterator[Host]:
    """Serve a folder from this very machine, where browsers allow WebGPU without https."""
    host = Host()
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(_Handler, host=host, directory=folder)) as server:
        host.address = f"http://127.0.0.1:{server.server_port}/"
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield host
        server.shutdown()


def prefix_worker(context: BrowserContext, script: str) -> None:
    """Run a script in the page's worker before its own."""

    def answer(route: Route) -> None:
        response = route.fetch()
        route.fulfill(response=response, body=script + response.text())

    context.route("**/worker.js", answer)
