"""A phone's side of the server: uploads in pieces, and what the page is told."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from pocketgs.serve.pieces import MAX_PIECE
from viewer.client import Answer, fetch, origin_of

PATIENCE = 240.0
"""Seconds: the first run compiles kernels."""


@dataclass(frozen=True)
class Phone:
    """Requests that a page can send to a server.

    Attributes:
        url: of the page.
    """

    url: str

    def tell(self, path: str, content: Any = None, **headers: str) -> Answer:
        headers = {"Origin": origin_of(self.url), **headers}
        return fetch(self.url, path, method="POST", body=json.dumps(content).encode(), headers=headers)

    def begin(self, files: Mapping[str, bytes], title: str = "toys", effort: str = "quick") -> Answer:
        """State what is to be uploaded."""
        stated = [{"name": name, "size": len(content)} for name, content in files.items()]
        return self.tell("captures", {"title": title, "effort": effort, "files": stated})

    def put(self, capture: str, number: int, offset: int, piece: bytes, **headers: str) -> Answer:
        headers = {"Origin": origin_of(self.url), **headers}
        path = f"captures/{capture}/files/{number}?offset={offset}"
        return fetch(self.url, path, method="PUT", body=piece, headers=headers)

    def upload(self, files: Mapping[str, bytes], title: str = "toys", effort: str = "quick") -> str:
        """Upload files; returns the capture's id."""
        begun = self.begin(files, title, effort)
        assert begun.status == 200, begun.body
        for number, name in enumerate(begun.json["names"], start=1):
            for offset in range(0, len(files[name]), MAX_PIECE):
                piece = files[name][offset : offset + MAX_PIECE]
                answer = self.put(begun.json["id"], number, offset, piece)
                assert answer.json == {"received": offset + len(piece)}
        return str(begun.json["id"])

    @property
    def shelf(self) -> dict[str, Any]:
        return dict(fetch(self.url, "shelf.json").json)

    def capture(self, identity: str) -> dict[str, Any]:
        """The server's entry for a capture."""
        return next(dict(each) for each in self.shelf["captures"] if each["id"] == identity)

    def until(self, identity: str, wanted: str | Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Wait until a capture is in a state, or meets a condition."""
        is_there = wanted if callable(wanted) else lambda capture: capture["state"] == wanted
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            capture = self.capture(identity)
            if is_there(capture):
                return capture
            time.sleep(0.05)
        raise AssertionError(capture)
