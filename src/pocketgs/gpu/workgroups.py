"""How work is divided over a GPU's threads: numbers that every shader and the host agree on."""

from __future__ import annotations

THREADS = 256
"""Of most workgroups: as many as every device must allow."""

BLOCK = 2048
"""Items that a workgroup sorts or adds up."""

DIGIT_BITS = 4
"""The radix sort's digits."""

LONGEST_ROW = 65_535
"""No dimension of a dispatch may be longer."""

CONSTANTS = {"THREADS": THREADS, "BLOCK": BLOCK, "DIGIT_BITS": DIGIT_BITS, "LONGEST_ROW": LONGEST_ROW}
