"""Numbers of the sweep's passes that shaders and host share."""

from __future__ import annotations

from pocketgs.gpu.workgroups import THREADS

PATCH = 16
"""Side in pixels of the patches that matching costs are computed in: one thread per pixel of a workgroup."""

CHUNK = 32
"""Hypotheses that one workgroup compares a patch at."""

LANE = 8
"""Hypotheses that one thread follows along a path: their costs are two words, their sums four."""

PATH_THREADS = 64
"""Threads of a workgroup that follows paths."""

MOST_HYPOTHESES = LANE * PATH_THREADS

MOST_BANDS = 4
"""Maximum number of bands of rows that a volume is divided into."""

MATCHED, USABLE = 1 << 24, 1 << 25
"""Bits of a photograph's pixel, above its three colours: it is not masked; it is neither masked nor transparent."""

assert PATCH * PATCH == THREADS
