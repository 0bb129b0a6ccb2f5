"""Random bits that are a pure function of numbers."""

from __future__ import annotations

from pocketgs.system.compile import inlined


@inlined
def pcg_hash(word: int) -> int:
    """32 well-mixed bits of 32 bits (the output function of PCG, Jarzynski and Olano 2020)."""
    state = (word * 747796405 + 2891336453) & 0xFFFFFFFF
    state = (((state >> ((state >> 28) + 4)) ^ state) * 277803737) & 0xFFFFFFFF
    return (state >> 22) ^ state
