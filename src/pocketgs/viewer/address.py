"""The page's addresses in the local network, and a QR code for phones."""

from __future__ import annotations

import io
import socket
from contextlib import suppress

import psutil
import segno

LOOPBACK = "127.0.0.1"
ANY_ADDRESS = "0.0.0.0"

_ELSEWHERE = ("192.0.2.1", 9)
"""An address reserved for documentation, which no machine has (RFC 5737)."""


def lan_addresses() -> list[str]:
    """IPv4 addresses of this machine in the local network, that of outgoing traffic first."""
    families = [address for card in psutil.net_if_addrs().values() for address in card]
    found = {one.address for one in families if one.family == socket.AF_INET and not one.address.startswith("127.")}
    return sorted(found, key=lambda address: (address != _outgoing_address(), address))


def _outgoing_address() -> str | None:
    with suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        # Connecting a datagram socket sends nothing: the system only chooses the route.
        probe.connect(_ELSEWHERE)
        return str(probe.getsockname()[0])
    return None


def host_names() -> list[str]:
    """Names of this machine in the local network, in lower case."""
    name = socket.gethostname().lower()
    # Host headers and certificates are ASCII only.
    return [name, f"{name.split('.')[0]}.local"] if name and name.isascii() else []


def page_url(host: str, port: int, token: str, *, secure: bool) -> str:
    """The page's address, with the secret token."""
    return f"{'https' if secure else 'http'}://{host}:{port}/{token}/"


def qr_code(url: str) -> str:
    """A QR code in half blocks, to be printed in white on black."""
    drawing = io.StringIO()
    segno.make(url, error="l", micro=False).terminal(drawing, border=2, compact=True)
    return drawing.getvalue().rstrip("\n")
