"""Access control: requests need the secret token in the path and a host name of this machine."""

from __future__ import annotations

import secrets
from dataclasses import dataclass, field
from urllib.parse import urlsplit

from pocketgs.viewer.address import lan_addresses

TOKEN_BYTES = 16


def new_token() -> str:
    """A secret that cannot be guessed."""
    return secrets.token_urlsafe(TOKEN_BYTES)


@dataclass(frozen=True)
class Access:
    """The requirements for requests.

    Attributes:
        hosts: names and addresses of the server, in lower case.
        token: first part of every path.
        network: whether the local network is served.
    """

    hosts: frozenset[str]
    token: str = field(default_factory=new_token, repr=False)
    network: bool = False

    def serves_host(self, host: str) -> bool:
        """Whether a Host header names this server.

        Protects against DNS rebinding: a foreign page can point its own name at this machine, but the browser then
        sends that name. The port is not checked, since there may be a tunnel in between.
        """
        try:
            name = urlsplit(f"//{host}").hostname
        except ValueError:  # unbalanced brackets
            return False
        # This machine may have got another address since, such as in another network.
        return name in self.hosts or (self.network and name in lan_addresses())

    def opens(self, path: str) -> bool:
        """Whether a path starts with the token, compared in constant time."""
        first = path.removeprefix("/").partition("/")[0]
        return secrets.compare_digest(first.encode(errors="replace"), self.token.encode())


def is_same_origin(origin: str | None, scheme: str, host: str) -> bool:
    """Whether an Origin header names the page that this server serves under a Host header.

    Browsers let any page open a WebSocket to any server, and name the page's origin only in this header.
    """
    return origin is not None and origin.lower() == f"{scheme}://{host}".lower()
