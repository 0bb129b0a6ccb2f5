"""A check: `pocketgs.serve.intake` as a child process."""

from __future__ import annotations

import asyncio
import os
from contextlib import suppress
from pathlib import Path

from pocketgs.errors import PocketGSError
from pocketgs.serve import child

SECONDS_TO_CHECK = 900.0


class Check:
    """A check of a complete upload."""

    def __init__(self) -> None:
        self._child: asyncio.subprocess.Process | None = None

    async def run(self, place: Path, max_bytes: int, folder: Path) -> tuple[int, str]:
        """Check, and return the exit status and what was said last.

        Args:
            place: the capture's folder.
            max_bytes: bound of what an archive unpacks to.
            folder: to work in.

        Raises:
            PocketGSError: it took too long.
        """
        arguments = ("pocketgs.serve.intake", str(place), str(max_bytes), str(os.getpid()))
        self._child = await child.start(arguments, folder)
        try:
            said, _ = await asyncio.wait_for(self._child.communicate(), SECONDS_TO_CHECK)
        except asyncio.TimeoutError as error:
            raise PocketGSError("checking it took too long") from error
        finally:
            await self.end()
        lines = said.decode(errors="replace").strip().splitlines() or [""]
        return await self._child.wait(), lines[-1]

    async def end(self) -> None:
        """Kill the process, and wait until it is gone."""
        if self._child and self._child.returncode is None:
            with suppress(ProcessLookupError):  # it has just ended by itself
                self._child.kill()
            await self._child.wait()
