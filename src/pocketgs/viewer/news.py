"""The latest state of a run, for pages.

Each post replaces the previous one of its kind, so that slow pages skip states instead of queueing them, and late pages
receive the current state.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from pocketgs.viewer.content import Content

FIRST_PROGRESS: dict[str, Any] = {
    "stage": "starting",
    "iteration": 0,
    "iterations": 0,
    "loss": None,
    "held_out_psnr": None,
    "seconds_left": None,
    "gaussians": 0,
    "memory_mb": 0.0,
    "paused": False,
    "finished": False,
}

SECONDS_TO_POLL = 5.0
"""How long after its last request a page that polls counts as open."""


@dataclass(frozen=True)
class Read:
    """A page's position: how often each kind had been posted when the page last read it."""

    content: int = 0
    progress: int = 0
    samples: int = 0
    scene: int = 0


class News:
    """The latest state of a run; thread-safe.

    Args:
        content: initial content of the page.
    """

    def __init__(self, content: Content) -> None:
        self._lock = threading.Lock()
        self._content, self._contents = content, 0
        self._progress, self._progresses = dict(FIRST_PROGRESS), 1
        self._samples: list[dict[str, Any]] = []
        self._scene, self._scene_iteration, self._scenes = b"", 0, 0
        self._readers, self._polled = 0, float("-inf")

    @property
    def content(self) -> Content:
        """The current content of the page."""
        return self._content

    @property
    def progress(self) -> dict[str, Any]:
        """A copy of the progress, see FIRST_PROGRESS."""
        with self._lock:
            return dict(self._progress)

    @property
    def scene(self) -> bytes:
        """The scene that was posted last, as an .spz file; empty before the first one."""
        return self._scene

    @property
    def readers(self) -> int:
        """Number of pages that are open; all that poll count as one."""
        return self._readers + (time.monotonic() - self._polled < SECONDS_TO_POLL)

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Count a reader while the block runs."""
        with self._lock:
            self._readers += 1
        try:
            yield
        finally:
            with self._lock:
                self._readers -= 1

    def note_poll(self) -> None:
        """Count a reader for a while."""
        self._polled = time.monotonic()

    def post_content(self, content: Content) -> None:
        """Replace cameras, photographs or previews."""
        with self._lock:
            self._content = content
            self._contents += 1

    def post_progress(self, **changes: Any) -> None:
        """Update some fields of the progress, see FIRST_PROGRESS."""
        with self._lock:
            self._progress |= changes
            self._progresses += 1

    def post_sample(self, iteration: int, loss: float | None, held_out_psnr: float | None) -> None:
        """Add a point to the curves."""
        with self._lock:
            self._samples.append({"iteration": iteration, "loss": loss, "held_out_psnr": held_out_psnr})

    def post_scene(self, iteration: int, encoded: bytes) -> None:
        """Publish the scene of an iteration.

        Args:
            iteration: number of the iteration.
            encoded: the scene as an .spz file.
        """
        with self._lock:
            self._scene, self._scene_iteration = encoded, iteration
            self._scenes += 1

    def since(self, read: Read) -> tuple[list[dict[str, Any] | bytes], Read]:
        """The messages that a page has not read yet, and its new position. The bytes are the scene announced before."""
        messages: list[dict[str, Any] | bytes] = []
        with self._lock:
            now = Read(self._contents, self._progresses, len(self._samples), self._scenes)
            if now.content > read.content:
                messages.append({"type": "cameras", "viewer": self._content.to_json()})
            if now.progress > read.progress or now.samples > read.samples:
                messages.append({"type": "progress", **self._progress, "samples": self._samples[read.samples :]})
            if now.scene > read.scene:
                about = {"iteration": self._scene_iteration, "format": "spz", "bytes": len(self._scene)}
                messages += [{"type": "scene", **about}, self._scene]
        return messages, now
