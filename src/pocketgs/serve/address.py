"""The page's address, kept in the folder: a phone finds the page again after the server was started anew."""

from __future__ import annotations

import json
import re
import socket
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from pocketgs.errors import PocketGSError
from pocketgs.files.atomic_file import replacing
from pocketgs.files.json_fields import read_json
from pocketgs.files.manifest import PRIVATE
from pocketgs.viewer.access import new_token

FILE = f"{PRIVATE}/address.json"
_TOKEN = re.compile(r"[\w-]{22,64}", re.ASCII)


@dataclass(frozen=True)
class KeptAddress:
    """The parts of the address that are chosen at random.

    Attributes:
        token: the secret.
        port: of the last time; 0 for any.
    """

    token: str
    port: int


def kept_address(folder: Path) -> KeptAddress:
    """The address of the last time, or a new one."""
    with suppress(PocketGSError):
        fields = read_json(folder / FILE)
        token, port = fields.text("token"), int(fields.number("port"))
        if _TOKEN.fullmatch(token) and 0 <= port < 65536:
            return KeptAddress(token, port)
    return KeptAddress(new_token(), 0)


def keep_address(folder: Path, address: KeptAddress) -> None:
    """Keep an address for the next time, readable by this user only.

    Raises:
        PocketGSError: it cannot be written.
    """
    with replacing(folder / FILE) as partial:
        partial.touch(mode=0o600)
        partial.write_text(json.dumps(asdict(address)) + "\n", encoding="utf-8")


def is_free(host: str, port: int) -> bool:
    """Whether a port can be listened on."""
    with suppress(OSError), socket.create_server((host, port)):
        return True
    return False
