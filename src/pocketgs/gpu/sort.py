"""Passes for a radix sort and for prefix sums."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pocketgs.gpu.description import Pass
from pocketgs.gpu.workgroups import DIGIT_BITS


@dataclass(frozen=True)
class Items:
    """A list on the GPU.

    Attributes:
        count: buffer whose first word is the number of items.
        blocks: number of blocks of BLOCK items, an expression. None if the GPU computes it: then `indirect` says where.
        indirect: a buffer and the byte offset of a dispatch's three sizes in it, with one workgroup per block.
    """

    count: str
    blocks: str | None = None
    indirect: tuple[str, int] | None = None


def digit_counts_bytes(blocks: str) -> str:
    """Bytes of `digit_counts`, which every sort needs: one count per digit and block; `blocks` is an expression."""
    return f"{4 << DIGIT_BITS} * {blocks}"


def radix_sort(items: Items, keys: str, values: str, digit: str, bits: int, when: Callable[[int], str]) -> list[Pass]:
    """Stable sort by the lowest bits of the keys.

    Args:
        items: the number of items.
        keys: buffer; like the buffer of values it has a spare one. The number of digits is even, so that the result
            ends up here and not in the spare buffers.
        values: buffer.
        digit: buffer that holds the current digit; starts as 0.
        bits: number of bits to sort by.
        when: maps a digit's lowest bit to the condition under which the digit is sorted.
    """
    source, target = (keys, values), (f"{keys}_spare", f"{values}_spare")
    blocks, count = (items.blocks, items.indirect), {"item_count": items.count}
    passes = []
    for shift in range(0, bits, DIGIT_BITS):
        counted = {**count, "keys": source[0], "digit": digit}
        placed = {**count, "counts": "digit_counts", "digit": digit}
        moved = {**counted, "values": source[1], "sorted_keys": target[0], "sorted_values": target[1]}
        passes += [
            Pass(f"count digits of {keys}", "radix_count", *blocks, counted, when=when(shift)),
            Pass(f"place {keys}", "radix_place", "1", None, placed, when=when(shift)),
            Pass(f"scatter {keys}", "radix_scatter", *blocks, moved, when=when(shift)),
        ]
        source, target = target, source
    return passes


def running_sums(items: Items, values: str, order: str, block_sums: str, sums: str) -> list[Pass]:
    """Exclusive prefix sums of values, with the total at the end.

    Args:
        items: the number of items.
        values: buffer of u32.
        order: buffer with the indices of the values, in the order to sum them.
        block_sums: buffer with one word per block.
        sums: buffer with one word per item, plus one.
    """
    blocks, taken = (items.blocks, items.indirect), {"item_count": items.count, "values": values, "order": order}
    return [
        Pass(f"sum blocks of {values}", "scan_sums", *blocks, {**taken, "block_sums": block_sums}),
        Pass(f"place blocks of {values}", "scan_blocks", "1", None, {"item_count": items.count, "counts": block_sums}),
        Pass(f"place {values}", "scan_within", *blocks, {**taken, "block_sums": block_sums, "sums": sums}),
    ]
