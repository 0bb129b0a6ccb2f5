"""Measured peak performance of a device: memory bandwidth and floating-point throughput."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import wgpu

MAX_ROW_LENGTH = 65_535
SECONDS = 0.1
"""Minimum duration of a measurement, which is repeated until it takes this long."""

COPY_BYTES = {"gpu": 512_000_000, "software": 64_000_000}
FMA_GROUPS = {"gpu": 8192, "software": 16}

ROUNDS = 256
CHAINS = "abcdefgh"
"""Vectors of four, each updated 4 times per round: 32 independent sums."""

FLOPS_PER_THREAD = ROUNDS * 4 * len(CHAINS) * 4 * 2

COPY = """
@group(0) @binding(0) var<storage, read> original: array<vec4u>;
@group(0) @binding(1) var<storage, read_write> copy: array<vec4u>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = (workgroup.y * groups.x + workgroup.x) * 256u + thread;
    if (index < arrayLength(&original)) {
        copy[index] = original[index];
    }
}
"""

FMA = f"""
@group(0) @binding(0) var<storage, read> numbers: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> results: array<vec4f>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {{
    let factor = numbers[0];
    let summand = numbers[1];
    {" ".join(f"var {name} = numbers[{number}] + f32(thread);" for number, name in enumerate(CHAINS))}
    for (var round = 0u; round < {ROUNDS}u; round++) {{
        {" ".join(4 * [f"{name} = fma({name}, factor, summand);" for name in CHAINS])}
    }}
    results[workgroup.x * 256u + thread] = {" + ".join(CHAINS)};
}}
"""


@dataclass(frozen=True)
class Roofline:
    """The two limits of the roofline model (Williams et al. 2009).

    Attributes:
        bytes_per_second: read and written together, by a shader that copies a large buffer.
        flops_per_second: of float32, by a shader of fused multiply-adds, which count as two.
    """

    bytes_per_second: float
    flops_per_second: float


def measure_roofline(device: Any, is_software: bool) -> Roofline:
    """Measure a device.

    Args:
        device: from `shared_device`.
        is_software: whether the device is a software adapter, which gets less work.
    """
    kind = "software" if is_software else "gpu"
    largest = min(device.limits["max-buffer-size"], device.limits["max-storage-buffer-binding-size"])
    size = min(COPY_BYTES[kind], largest) // 4096 * 4096
    copy_seconds = _seconds(device, COPY, size, size, size // 16 // 256)
    groups = FMA_GROUPS[kind]
    fma_seconds = _seconds(device, FMA, 256, 16 * 256 * groups, groups)
    return Roofline(2 * size / copy_seconds, FLOPS_PER_THREAD * 256 * groups / fma_seconds)


def _seconds(device: Any, source: str, read_bytes: int, written_bytes: int, groups: int) -> float:
    """Seconds of one dispatch of a shader."""
    usage = wgpu.BufferUsage.STORAGE | wgpu.BufferUsage.COPY_SRC
    buffers = [device.create_buffer(size=size, usage=usage) for size in (read_bytes, written_bytes)]
    module = device.create_shader_module(code=source)
    pipeline = device.create_compute_pipeline(layout="auto", compute={"module": module, "entry_point": "main"})
    entries = [{"binding": number, "resource": {"buffer": buffer}} for number, buffer in enumerate(buffers)]
    bind_group = device.create_bind_group(layout=pipeline.get_bind_group_layout(0), entries=entries)

    def run(times: int) -> None:
        encoder = device.create_command_encoder()
        compute = encoder.begin_compute_pass()
        compute.set_pipeline(pipeline)
        compute.set_bind_group(0, bind_group)
        for _ in range(times):
            compute.dispatch_workgroups(min(groups, MAX_ROW_LENGTH), -(-groups // MAX_ROW_LENGTH))
        compute.end()
        device.queue.submit([encoder.finish()])
        device.queue.read_buffer(buffers[1], 0, 16)

    return _per_run(run)


def _per_run(run: Callable[[int], None]) -> float:
    """Seconds per run, from enough runs to measure."""
    run(1)
    times = 1
    while True:
        started = time.perf_counter()
        run(times)
        elapsed = time.perf_counter() - started
        if elapsed >= SECONDS:
            return elapsed / times
        times *= 2
