"""Servers of a folder, and what is uploaded to them."""

from __future__ import annotations

import asyncio
import io
import json
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from PIL import Image

from pocketgs import Capture
from pocketgs.results.folder import RECORD
from pocketgs.serve.entry import Entry, State, UploadedFile
from pocketgs.serve.queue import Queue
from pocketgs.serve.server import ServeOptions, serving_folder
from pocketgs.serve.shelf import RESULT, Shelf, new_id
from serve.client import Phone
from zip_files import zip_of

MINIMAL = ("--prior", "none", "--engine", "cpu", "--threads", "1", "--evaluate-every", "0")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "shelf"


@pytest.fixture
def untrained(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the queue stand still."""

    async def wait(_: Queue) -> None:
        await asyncio.Event().wait()

    monkeypatch.setattr(Queue, "train_queued", wait)


@pytest.fixture
def serve(folder: Path) -> Iterator[Callable[..., Phone]]:
    """A function that serves the folder until the test ends, on this machine only."""
    with ExitStack() as stack:

        def start(**options: object) -> Phone:
            flags = {"quick": (*MINIMAL, "--iterations", "20"), "best": (*MINIMAL, "--iterations", "1000000")}
            chosen = ServeOptions(**{"flags": flags, "effort": "quick", **options})  # type: ignore[arg-type]
            page, warnings = stack.enter_context(serving_folder(folder, chosen))
            assert warnings == []
            return Phone(page.url)

        yield start


@pytest.fixture(scope="session")
def photographs(small_capture: Capture) -> dict[str, bytes]:
    """Eight JPEG files."""
    return {f"IMG_{number}.JPG": jpeg(frame.image) for number, frame in enumerate(small_capture.frames, start=5)}


@pytest.fixture(scope="session")
def zipped(written_capture: Path) -> bytes:
    """A capture of nerfstudio's format as a zip file, with a folder inside as phones make them."""
    files = [path for path in sorted(written_capture.rglob("*")) if path.is_file()]
    return zip_of({f"toys/{path.relative_to(written_capture).as_posix()}": path.read_bytes() for path in files})


def left_behind(folder: Path, state: State, *files: str, record: dict[str, object] | None = None) -> Entry:
    """A capture on the shelf whose last run began a minute ago and has left files, and perhaps its record."""
    shelf, video = Shelf(folder), UploadedFile("a.mov", "0001.mov", 5)
    entry = Entry(new_id(), "toys", "video", (video,), "quick", 1.0, state, begun=time.time() - 60, flags=("--old",))
    shelf.add(entry)
    result = shelf.place(entry) / RESULT
    result.mkdir()
    for name in files:
        (result / name).write_bytes(b"x")
    if record:
        (result / RECORD).write_text(json.dumps(record))
    return entry


def jpeg(pixels: object) -> bytes:
    content = io.BytesIO()
    Image.fromarray(pixels).save(content, "JPEG")  # type: ignore[arg-type]
    return content.getvalue()
