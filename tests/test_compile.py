"""Machine code on disk belongs to one state of the sources."""

from __future__ import annotations

from pathlib import Path

from pocketgs import compile as compilation
from pocketgs.splat.cpu.rasterize import rasterize


def test_cached_code_is_kept_by_the_state_of_its_rooms_sources() -> None:
    folder = Path(rasterize.stats.cache_path)  # type: ignore[attr-defined]
    assert any(part == f"splat-{compilation._digest_of('splat')}" for part in folder.parts)


def test_rooms_have_digests_of_their_own() -> None:
    assert compilation._digest_of("splat") != compilation._digest_of("capture")
