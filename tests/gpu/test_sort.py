"""Sorting and adding up on the GPU, without anything else: against NumPy."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from pocketgs.gpu.adapters import Adapter, adapters
from pocketgs.gpu.description import Description, Sequence
from pocketgs.gpu.device import shared_device
from pocketgs.gpu.executor import Executor
from pocketgs.gpu.shader_library import SHADERS, ShaderLibrary
from pocketgs.gpu.sort import Items, digit_counts_bytes, radix_sort, running_sums
from pocketgs.gpu.timing import CLEAR, by_waiting
from pocketgs.gpu.workgroups import BLOCK

COUNTS = pytest.mark.parametrize("count", [1, 255, 2048, 2049, 70_000])
BITS = 16
LISTS = ("keys", "keys_spare", "values", "values_spare", "numbers")


@cache
def executor() -> Executor:
    items = Items("count", blocks="blocks")
    sequences = {
        "sort": Sequence(("digit",), tuple(radix_sort(items, "keys", "values", "digit", BITS, lambda _: "1"))),
        "sum": Sequence((), tuple(running_sums(items, "numbers", "values", "block_sums", "sums"))),
    }
    library, names = ShaderLibrary(SHADERS, {}), [path.stem for path in Path(SHADERS).glob("*.wgsl")]
    buffers = {name: "4 * items" for name in LISTS} | {"count": "4", "digit": "8", "block_sums": "4 * blocks"}
    buffers |= {"sums": "4 * items + 4", "digit_counts": digit_counts_bytes("blocks")}
    shaders = {name: library.link(name, {"scan.exclusive": "scan.shared"}) for name in names}
    definitions = {"blocks": f"ceil_div(items, {BLOCK})"}
    description = Description(definitions, buffers, {}, shaders, sequences)
    return Executor(shared_device(adapters()[0]), description)


def reserve(count: int, **contents: np.ndarray) -> dict[str, int]:
    """Make room for so many items, and fill buffers; the numbers that sizes follow from."""
    description = executor().description
    symbols = description.symbols({"items": count})
    executor().reserve(description.sizes(symbols, description.buffers))
    for name, content in {"count": np.array([count]), **contents}.items():
        executor().write(name, content.astype(np.uint32))
    return symbols


@COUNTS
@pytest.mark.usefixtures("adapter")
def test_sort_is_stable(count: int) -> None:
    keys = np.random.default_rng(count).integers(0, 2**BITS, count) // 7 * 7
    symbols = reserve(count, keys=keys, values=np.arange(count))
    executor().submit("sort", symbols)
    order = np.argsort(keys, kind="stable")
    np.testing.assert_array_equal(executor().read("values", np.uint32, count), order)
    np.testing.assert_array_equal(executor().read("keys", np.uint32, count), keys[order])


@COUNTS
@pytest.mark.usefixtures("adapter")
def test_running_sums_follow_the_order(count: int) -> None:
    rng = np.random.default_rng(count)
    numbers, order = rng.integers(0, 1000, count), rng.permutation(count)
    symbols = reserve(count, numbers=numbers, values=order)
    executor().submit("sum", symbols)
    found = executor().read("sums", np.uint32, count + 1)
    np.testing.assert_array_equal(found, np.concatenate([[0], np.cumsum(numbers[order])]))


@pytest.mark.parametrize("waiting", [False, True])
def test_every_pass_is_timed(adapter: Adapter, monkeypatch: pytest.MonkeyPatch, waiting: bool) -> None:
    """By timestamps or by waiting; the results are the same."""
    keys = np.array([5, 3, 4, 3])
    symbols = reserve(4, keys=keys, values=np.arange(4))
    if waiting:
        monkeypatch.setattr(Executor, "has_timestamps", False)
    elif not executor().has_timestamps:
        pytest.skip(f"{adapter.name} has no timestamps")
    with executor().timed() as times:
        executor().submit("sort", symbols)
        executor().submit("sum", symbols)
    np.testing.assert_array_equal(executor().read("keys", np.uint32, 4), [3, 3, 4, 5])
    names = {one.name for sequence in executor().description.sequences.values() for one in sequence.passes}
    assert set(times.medians()) == {CLEAR, *names}
    assert [len(times.milliseconds[name]) for name in (CLEAR, "place keys", "place numbers")] == [2, 1, 1]
    assert all(duration >= 0.0 for durations in times.milliseconds.values() for duration in durations)
    assert times.symbols == symbols
    executor().submit("sort", symbols)
    assert len(times.milliseconds[CLEAR]) == 2, "what is submitted later is not timed"
    assert all(duration > 0.0 for duration in by_waiting(executor().device, lambda _: None, [lambda _: None]))
