"""Passes that sort a list by its keys, and passes that add one up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pocketgs.gpu.description import Pass
from pocketgs.gpu.workgroups import DIGIT_BITS


@dataclass(frozen=True)
class Items:
    """A list on the GPU.

    Attributes:
        count: buffer whose first word says how many items there are.
        blocks: how many blocks of BLOCK items, an expression. None where the GPU counts them: `indirect` says where.
        indirect: a buffer and the offset in bytes of a dispatch's three sizes, with one workgroup per block.
    """

    count: str
    blocks: str | None = None
    indirect: tuple[str, int] | None = None


def digit_counts_bytes(blocks: str) -> str:
    """Bytes of `digit_counts`, which every sort needs: the digits' counts in each of so many blocks, an expression."""
    return f"{4 << DIGIT_BITS} * {blocks}"


def radix_sort(items: Items, keys: str, values: str, digit: str, bits: int, when: Callable[[int], str]) -> list[Pass]:
    """Sort by the lowest bits of the keys; equal keys stay in their order.

    Args:
        items: how many there are.
        keys: buffer; like that of the values it has a spare one. The digits are even in number, so that the result lies
            in these and not in the spare ones.
        values: buffer.
        digit: buffer that says which digit's turn it is; all 0 before.
        bits: how many.
        when: from a digit's lowest bit to the condition on which it is sorted by.
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
    """Sum, for every item, the values of those before it; and in the end of all.

    Args:
        items: how many there are.
        values: buffer of u32.
        order: buffer that lists, one after the other, the places of the values to take.
        block_sums: buffer with a word for each block.
        sums: buffer with a word for each item, and one more.
    """
    blocks, taken = (items.blocks, items.indirect), {"item_count": items.count, "values": values, "order": order}
    return [
        Pass(f"sum blocks of {values}", "scan_sums", *blocks, {**taken, "block_sums": block_sums}),
        Pass(f"place blocks of {values}", "scan_blocks", "1", None, {"item_count": items.count, "counts": block_sums}),
        Pass(f"place {values}", "scan_within", *blocks, {**taken, "block_sums": block_sums, "sums": sums}),
    ]
