"""Machine code on disk belongs to one state of the sources."""

from __future__ import annotations

from pocketgs.splat.cpu import compile as compilation
from pocketgs.splat.cpu.rasterize import rasterize


def test_cached_code_is_kept_by_the_state_of_all_sources() -> None:
    digest = compilation._digest_of_sources()
    assert f"kernels-{digest}" in str(rasterize.stats.cache_path)  # type: ignore[attr-defined]
