"""The time that each pass of a step of the WebGPU engine takes."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any
from unittest.mock import patch

import numpy as np
import wgpu
from wgpu.backends.wgpu_native import lib

from pocketgs.splat.engine import EngineOptions
from pocketgs.splat.webgpu import engine as engine_module
from pocketgs.splat.webgpu.adapters import Adapter, open_device
from pocketgs.splat.webgpu.engine import WebGpuEngine
from pocketgs.splat.webgpu.replay import Replayer
from pocketgs.splat.webgpu.sizes import Symbols

TIMESTAMPS = "timestamp-query"

CLEAR = "clear"
"""Filling buffers with zeros before the first pass."""


@dataclass
class PassTimes:
    """What was measured of some steps.

    Attributes:
        milliseconds: by the pass's name, a number a step; passes of one name are added up.
        symbols: the numbers that sizes were computed from in the last step.
    """

    milliseconds: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    symbols: Symbols = field(default_factory=dict)

    def medians(self) -> dict[str, float]:
        """Milliseconds of every pass in the median step."""
        return {name: float(np.median(values)) for name, values in self.milliseconds.items()}


def engine_to_time(options: EngineOptions) -> WebGpuEngine:
    """An engine on a device that measures the time itself, where the adapter can."""

    def open_with_timestamps(adapter: Adapter, features: frozenset[str] = frozenset()) -> Any:
        return open_device(adapter, features | ({TIMESTAMPS} & adapter.features))

    with patch.object(engine_module, "open_device", open_with_timestamps):
        return WebGpuEngine(options)


def is_timed_by_device(engine: WebGpuEngine) -> bool:
    """Whether passes are timed by the device's timestamps; else each is submitted alone and waited for."""
    return TIMESTAMPS in engine._device.features


@contextmanager
def timed_passes(engine: WebGpuEngine) -> Iterator[PassTimes]:
    """Measure every step that the engine takes while the block runs."""
    replayer, times = engine._replayer, PassTimes()
    durations = _by_timestamps if is_timed_by_device(engine) else _by_waiting

    def submit(name: str, symbols: Symbols) -> None:
        sequence = replayer.description.sequences[name]
        passes = replayer.recorded(name, symbols)
        milliseconds = durations(replayer, sequence.cleared, [one.dispatch for one in passes])
        in_this_step: dict[str, float] = defaultdict(float)
        for pass_name, duration in zip([CLEAR, *(one.name for one in passes)], milliseconds, strict=True):
            in_this_step[pass_name] += duration
        for pass_name, duration in in_this_step.items():
            times.milliseconds[pass_name].append(duration)
        times.symbols = symbols

    with patch.object(replayer, "submit", submit):
        yield times


Dispatch = Callable[[Any], None]


def _by_timestamps(replayer: Replayer, cleared: Sequence[str], dispatches: Sequence[Dispatch]) -> list[float]:
    """Milliseconds of the clearing and of each dispatch, all submitted together, a compute pass each."""
    device, count = replayer._device, 2 * (len(dispatches) + 1)
    queries = device.create_query_set(type=wgpu.QueryType.timestamp, count=count)
    usage = wgpu.BufferUsage.QUERY_RESOLVE | wgpu.BufferUsage.COPY_SRC
    resolved = device.create_buffer(size=8 * count, usage=usage)
    encoder = device.create_command_encoder()

    def encode(number: int, dispatch: Dispatch | None = None) -> None:
        ends = {"beginning_of_pass_write_index": 2 * number, "end_of_pass_write_index": 2 * number + 1}
        compute = encoder.begin_compute_pass(timestamp_writes={"query_set": queries, **ends})
        if dispatch:
            dispatch(compute)
        compute.end()

    encode(0)
    for name in cleared:
        encoder.clear_buffer(replayer._buffers[name])
    for number, dispatch in enumerate(dispatches, 1):
        encode(number, dispatch)
    encoder.resolve_query_set(queries, 0, count, resolved, 0)
    device.queue.submit([encoder.finish()])
    begins, ends = np.frombuffer(device.queue.read_buffer(resolved), np.uint64).reshape(-1, 2).T.astype(np.float64)
    ticks = [begins[1] - ends[0], *(ends[1:] - begins[1:])]
    # wgpu-py has no method for it.
    nanoseconds = lib.wgpuQueueGetTimestampPeriod(device.queue._internal)
    return [float(duration) * nanoseconds / 1e6 for duration in ticks]


def _by_waiting(replayer: Replayer, cleared: Sequence[str], dispatches: Sequence[Dispatch]) -> list[float]:
    """Milliseconds of the clearing and of each dispatch, each submitted alone and waited for."""

    def encode_clearing(encoder: Any) -> None:
        for name in cleared:
            encoder.clear_buffer(replayer._buffers[name])

    def encode(dispatch: Dispatch, encoder: Any) -> None:
        compute = encoder.begin_compute_pass()
        dispatch(compute)
        compute.end()

    return [
        _milliseconds_to_wait(replayer, encode_clearing),
        *(_milliseconds_to_wait(replayer, lambda encoder, one=one: encode(one, encoder)) for one in dispatches),
    ]


def _milliseconds_to_wait(replayer: Replayer, encode: Callable[[Any], None]) -> float:
    device = replayer._device
    encoder = device.create_command_encoder()
    encode(encoder)
    started = time.perf_counter()
    device.queue.submit([encoder.finish()])
    replayer.read("status", np.uint32, 1)
    return 1e3 * (time.perf_counter() - started)


def milliseconds_of_waiting(engine: WebGpuEngine) -> float:
    """What submitting nothing and waiting for it takes: it is part of every time that is measured by waiting."""
    return float(np.median([_milliseconds_to_wait(engine._replayer, lambda encoder: None) for _ in range(20)]))
