"""Timing of passes."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import wgpu

from pocketgs.gpu.sizes import Symbols

CLEAR = "clear"
"""The step that fills buffers with zeros before the first pass."""

Encode = Callable[[Any], None]
"""Adds work to a command encoder, or to a compute pass."""


@dataclass
class PassTimes:
    """The measured times of some sequences.

    Attributes:
        milliseconds: by pass, one number per sequence; passes of the same name are added up.
        symbols: the numbers that sizes were computed from in the last sequence.
    """

    milliseconds: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    symbols: Symbols = field(default_factory=dict)

    def add(self, names: Sequence[str], milliseconds: Sequence[float], symbols: Symbols) -> None:
        """Add one sequence: the names and times of its passes."""
        sums: dict[str, float] = defaultdict(float)
        for name, duration in zip(names, milliseconds, strict=True):
            sums[name] += duration
        for name, duration in sums.items():
            self.milliseconds[name].append(duration)
        self.symbols = symbols

    def medians(self) -> dict[str, float]:
        """Median time of every pass in milliseconds."""
        return {name: float(np.median(values)) for name, values in self.milliseconds.items()}


def by_timestamps(device: Any, clear: Encode, dispatches: Sequence[Encode]) -> list[float]:
    """Time clearing and each dispatch in milliseconds with timestamps: one submission, one compute pass each."""
    count = 2 * (len(dispatches) + 1)
    queries = device.create_query_set(type=wgpu.QueryType.timestamp, count=count)
    usage = wgpu.BufferUsage.QUERY_RESOLVE | wgpu.BufferUsage.COPY_SRC
    resolved = device.create_buffer(size=8 * count, usage=usage)
    encoder = device.create_command_encoder()

    def encode(number: int, dispatch: Encode | None = None) -> None:
        ends = {"beginning_of_pass_write_index": 2 * number, "end_of_pass_write_index": 2 * number + 1}
        compute = encoder.begin_compute_pass(timestamp_writes={"query_set": queries, **ends})
        if dispatch:
            dispatch(compute)
        compute.end()

    encode(0)
    clear(encoder)
    for number, dispatch in enumerate(dispatches, 1):
        encode(number, dispatch)
    encoder.resolve_query_set(queries, 0, count, resolved, 0)
    device.queue.submit([encoder.finish()])
    begins, ends = np.frombuffer(device.queue.read_buffer(resolved), np.uint64).reshape(-1, 2).T.astype(np.float64)
    ticks = [begins[1] - ends[0], *(ends[1:] - begins[1:])] if dispatches else [ends[0] - begins[0]]
    return [float(duration) * _nanoseconds_per_tick(device) / 1e6 for duration in ticks]


def _nanoseconds_per_tick(device: Any) -> float:
    # wgpu-py has no method for this.
    from wgpu.backends.wgpu_native import lib

    return float(lib.wgpuQueueGetTimestampPeriod(device.queue._internal))


def by_waiting(device: Any, clear: Encode, dispatches: Sequence[Encode]) -> list[float]:
    """Time clearing and each dispatch in milliseconds by submitting each alone and waiting for it."""

    def encode(dispatch: Encode, encoder: Any) -> None:
        compute = encoder.begin_compute_pass()
        dispatch(compute)
        compute.end()

    return [
        milliseconds_to_wait(device, clear),
        *(milliseconds_to_wait(device, partial(encode, dispatch)) for dispatch in dispatches),
    ]


def milliseconds_to_wait(device: Any, encode: Encode) -> float:
    """Milliseconds from submitting some work alone until it is done."""
    word = device.create_buffer(size=4, usage=wgpu.BufferUsage.COPY_SRC)
    encoder = device.create_command_encoder()
    encode(encoder)
    started = time.perf_counter()
    device.queue.submit([encoder.finish()])
    device.queue.read_buffer(word)  # waits; wgpu-py's own way of waiting is broken in 0.32
    return 1e3 * (time.perf_counter() - started)
