"""The server of the page, in a thread of its own."""

from __future__ import annotations

import asyncio
import errno
import logging
import socket
import ssl
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError

from pocketgs.errors import PocketGSError
from pocketgs.viewer.access import Access, new_token
from pocketgs.viewer.address import ANY_ADDRESS, LOOPBACK, host_names, lan_addresses, page_url
from pocketgs.viewer.content import Content
from pocketgs.viewer.live import LiveRun
from pocketgs.viewer.routes import application

SECONDS_TO_STOP = 1.0


@dataclass(frozen=True)
class Page:
    """Addresses of the page.

    Attributes:
        url: on this machine; everyone who knows it can see the page.
        network_url: in the local network, or None if it is not served there.
        fingerprint: SHA-256 of its certificate, or None without one.
    """

    url: str
    network_url: str | None = None
    fingerprint: str | None = None


@contextmanager
def serving(
    shown: Content | LiveRun, *, network: bool = False, port: int = 0, certificates: Path | None = None
) -> Iterator[Page]:
    """Serve the page while the block runs.

    Args:
        shown: a scene, or a run to follow.
        network: serve the local network over https, with a self-signed certificate. Otherwise serve this machine only,
            over http, which browsers trust there.
        port: to listen on, or 0 for any free one.
        certificates: folder of the certificate; None for the user's cache folder.

    Raises:
        PocketGSError: the port is in use or not available, or the certificate cannot be written.
    """
    run = shown if isinstance(shown, LiveRun) else None
    content = (lambda: shown.news.content) if isinstance(shown, LiveRun) else (lambda: shown)

    def make(access: Access) -> web.Application:
        return application(access, content, run)

    with serving_application(make, network=network, port=port, certificates=certificates) as page:
        yield page


@contextmanager
def serving_application(
    make: Callable[[Access], web.Application],
    *,
    network: bool = False,
    port: int = 0,
    token: str | None = None,
    certificates: Path | None = None,
) -> Iterator[Page]:
    """Serve an application while the block runs; arguments and errors as for `serving`.

    Args:
        make: makes the application for the requirements that its requests have to meet.
        network: serve the local network.
        port: to listen on.
        token: first part of every path; None for a new one.
        certificates: folder of the certificate.
    """
    addresses = lan_addresses() if network else []
    hosts = list(dict.fromkeys([LOOPBACK, "localhost", *addresses, *(host_names() if network else [])]))
    access = Access(frozenset(hosts), token or new_token(), network)
    secret = _Secret.of(hosts, certificates) if network else None
    listener = _listen(ANY_ADDRESS if network else LOOPBACK, port)
    port = listener.getsockname()[1]
    urls = [page_url(host, port, access.token, secure=network) for host in (LOOPBACK, *addresses)]
    with _on_a_thread(make(access), listener, secret.context if secret else None):
        yield Page(urls[0], urls[1] if addresses else None, secret.fingerprint if secret else None)


@dataclass(frozen=True)
class _Secret:
    """What encrypts."""

    context: ssl.SSLContext
    fingerprint: str

    @staticmethod
    def of(hosts: list[str], folder: Path | None) -> _Secret:
        # Imported here because most pages are served to this machine only.
        from pocketgs.viewer.certificate import cache_folder, certificate_file, fingerprint

        path = certificate_file(hosts, folder or cache_folder())
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        context.load_cert_chain(path)
        return _Secret(context, fingerprint(path))


def _listen(host: str, port: int) -> socket.socket:
    """A listening socket.

    Raises:
        PocketGSError: the port is in use, not available, or invalid.
    """
    try:
        return socket.create_server((host, port))
    except OverflowError as error:
        raise PocketGSError(f"port {port}: found {port}, expected 0 to 65535") from error
    except OSError as error:
        reason = "in use" if error.errno == errno.EADDRINUSE else f"not available ({error.strerror or error})"
        raise PocketGSError(f"port {port}: {reason}, expected a free one, or 0 for any free one") from error


@contextmanager
def _on_a_thread(served: web.Application, listener: socket.socket, secret: ssl.SSLContext | None) -> Iterator[None]:
    """Serve requests in a thread while the block runs; closes the socket at the end."""
    started: Future[Callable[[], object]] = Future()

    async def serve() -> None:
        over, loop = asyncio.Event(), asyncio.get_running_loop()
        runner = web.AppRunner(
            served,
            access_log=None,
            logger=_logger(),
            shutdown_timeout=SECONDS_TO_STOP,
            lingering_time=0.0,  # do not wait for unread requests
        )
        try:
            await runner.setup()
            await web.SockSite(runner, listener, ssl_context=secret).start()
        except Exception as error:
            started.set_exception(error)
        else:
            started.set_result(lambda: loop.call_soon_threadsafe(over.set))
            await over.wait()
        finally:
            await runner.cleanup()

    with listener:
        thread = threading.Thread(target=asyncio.run, args=(serve(),), name="pocketgs-viewer", daemon=True)
        thread.start()
        stop = started.result()
        try:
            yield
        finally:
            stop()
            thread.join()


def _logger() -> logging.Logger:
    """Log our own errors with tracebacks, but not requests that are not HTTP."""
    logger = logging.getLogger("pocketgs.viewer")
    logger.addFilter(_is_ours)
    return logger


def _is_ours(record: logging.LogRecord) -> bool:
    return not (record.exc_info and isinstance(record.exc_info[1], HttpProcessingError))
