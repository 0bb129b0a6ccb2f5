"""Workgroup sizes, shared by all shaders and the host."""

from __future__ import annotations

THREADS = 256
"""Threads of most workgroups: the most that every device allows."""

BLOCK = 2048
"""Items that one workgroup sorts or sums."""

DIGIT_BITS = 4
"""Bits per digit of the radix sort."""

MAX_ROW_LENGTH = 65_535
"""Maximum number of workgroups in one dimension of a dispatch."""

CONSTANTS = {"THREADS": THREADS, "BLOCK": BLOCK, "DIGIT_BITS": DIGIT_BITS, "MAX_ROW_LENGTH": MAX_ROW_LENGTH}
