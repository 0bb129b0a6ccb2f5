"""Who may see the page: whoever knows the secret in its address, by a name that is this machine's."""

from __future__ import annotations

import secrets
from dataclasses import dataclass, field
from urllib.parse import urlsplit

TOKEN_BYTES = 16


def _new_token() -> str:
    return secrets.token_urlsafe(TOKEN_BYTES)


@dataclass(frozen=True)
class Access:
    """What a request must bring to be answered.

    Attributes:
        hosts: names and addresses, in lower case, that the server is reached by.
        token: first part of every path.
    """

    hosts: frozenset[str]
    token: str = field(default_factory=_new_token, repr=False)

    def serves_host(self, host: str) -> bool:
        """Whether a Host header names this server.

        A stranger's page can have its own name point to this machine and so read what is served here, but it cannot
        have the browser send another name than its own. Any port will do: there may be a tunnel in between.
        """
        try:
            name = urlsplit(f"//{host}").hostname
        except ValueError:  # brackets that do not close
            return False
        return name in self.hosts

    def opens(self, path: str) -> bool:
        """Whether a path starts with the token; takes the same time whatever it starts with instead."""
        first = path.removeprefix("/").partition("/")[0]
        return secrets.compare_digest(first.encode(errors="replace"), self.token.encode())


def is_same_origin(origin: str | None, scheme: str, host: str) -> bool:
    """Whether an Origin header names the very page that this server serves under a Host header.

    Browsers let any page open a WebSocket to any server and only say in this header whose page it is.
    """
    return origin is not None and origin.lower() == f"{scheme}://{host}".lower()
