"""Serving a folder of captures."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

from aiohttp import web

from pocketgs.files.lock import locked
from pocketgs.files.manifest import PRIVATE
from pocketgs.serve.address import KeptAddress, is_free, keep_address, kept_address
from pocketgs.serve.declaration import Bounds
from pocketgs.serve.queue import Queue
from pocketgs.serve.routes import shelf_application
from pocketgs.serve.shelf import SECONDS_IN_TRASH, Shelf, delete_folders
from pocketgs.viewer.access import Access
from pocketgs.viewer.address import ANY_ADDRESS, LOOPBACK
from pocketgs.viewer.server import Page, serving_application

SECONDS_BETWEEN_CLEANINGS = 3600.0


@dataclass(frozen=True)
class ServeOptions:
    """How a folder is served.

    Attributes:
        flags: of `pocketgs train`, by effort; the page offers these efforts.
        effort: that the page suggests.
        max_bytes: bound of an upload, and of what an archive unpacks to.
        network: serve the local network, see `pocketgs.viewer.server.serving`.
        port: to listen on; 0 for that of the last time, or any free one.
        certificates: folder of the certificate; None for the user's cache folder.
    """

    flags: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: {"standard": ()})
    effort: str = "standard"
    max_bytes: int = 4_000_000_000
    network: bool = False
    port: int = 0
    certificates: Path | None = None


@contextmanager
def serving_folder(folder: Path, options: ServeOptions) -> Iterator[tuple[Page, list[str]]]:
    """Serve a folder of captures while the block runs, and train what is uploaded.

    At the end the run that goes on is ended, as Ctrl-C does; the next server goes on with it.

    Args:
        folder: created if needed. Uploads and results stay in it.
        options: how.

    Yields:
        The page's addresses, and warnings for the user.

    Raises:
        PocketGSError: the folder cannot be used, another server uses it, or the port is in use.
    """
    shelf = Shelf(folder)
    with locked(shelf.folder / PRIVATE / "lock", folder):
        kept = kept_address(shelf.folder)
        host = ANY_ADDRESS if options.network else LOOPBACK
        port = options.port or (kept.port if is_free(host, kept.port) else 0)

        def make(access: Access) -> web.Application:
            queue = Queue(shelf, options.flags, options.max_bytes)
            bounds = Bounds(options.max_bytes, tuple(options.flags))
            application = shelf_application(access, shelf, queue, bounds, options.effort)
            application.cleanup_ctx.append(lambda _: _working(shelf, queue))
            return application

        with serving_application(
            make, network=options.network, port=port, token=kept.token, certificates=options.certificates
        ) as page:
            address = KeptAddress(kept.token, urlsplit(page.url).port or 0)
            if address != kept:
                keep_address(shelf.folder, address)
            yield page, shelf.warnings


async def _working(shelf: Shelf, queue: Queue) -> AsyncIterator[None]:
    """Do the shelf's work while it is served."""
    await queue.recover()
    tasks = [asyncio.create_task(work) for work in (queue.check_uploads(), queue.train_queued(), _clean(shelf))]
    yield
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def _clean(shelf: Shelf) -> None:
    while True:
        await asyncio.to_thread(delete_folders, shelf.empty_trash(SECONDS_IN_TRASH))
        await asyncio.sleep(SECONDS_BETWEEN_CLEANINGS)
