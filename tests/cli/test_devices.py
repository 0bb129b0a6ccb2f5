"""The output of `pocketgs info --devices`."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from pocketgs.cli.devices import FEATURES, NO_ADAPTER, device_lines
from pocketgs.gpu.adapters import NEEDED, Adapter, adapters, has_gpu

LIMITS = {**NEEDED, "max-buffer-size": 2_000_000_000, "max-storage-buffer-binding-size": 1_000_000_000}


def adapter(name: str, kind: str = "DiscreteGPU", features: tuple[str, ...] = FEATURES, **limits: int) -> Adapter:
    changed = LIMITS | {limit.replace("_", "-"): value for limit, value in limits.items()}
    return Adapter(name, kind, "Vulkan", "driver 1.2", frozenset(features), changed, None)


def lines_about(name: str, lines: list[str]) -> str:
    first = next(number for number, line in enumerate(lines) if line.startswith(f"{name}:"))
    return "\n".join(lines[first : first + 4])


def test_lists_what_this_machine_has(pocketgs: Callable[..., Any]) -> None:
    outcome = pocketgs("info", "--devices")
    assert (outcome.status, outcome.errors) == (0, "")
    found = adapters()
    assert all(f"{one.name}: {one.kind}, {one.backend}, {one.driver}" in outcome.output for one in found)
    assert (NO_ADAPTER in outcome.output) == (not found)
    assert ("\n  used by engine auto" in outcome.output) == has_gpu()
    cpu = outcome.output.splitlines()[-1]
    assert cpu.startswith("CPU engine: ")
    assert ("used by engine auto" in cpu) == (not has_gpu())


def test_version(pocketgs: Callable[..., Any]) -> None:
    outcome = pocketgs("--version")
    assert (outcome.status, outcome.output, outcome.errors) == (0, f"pocketgs {version('pocketgs')}\n", "")
    assert "--version" in pocketgs("--help").output


def test_beside_a_path(pocketgs: Callable[..., Any], written_capture: Path) -> None:
    output = pocketgs("info", written_capture, "--devices").output
    assert output.startswith("toys (nerfstudio)")
    assert "CPU engine: " in output


def test_neither_path_nor_devices(pocketgs: Callable[..., Any]) -> None:
    outcome = pocketgs("info")
    assert outcome.status == 2
    assert "found neither a path nor --devices, expected one of them" in outcome.errors


def test_auto_takes_the_best_adapter_that_lacks_nothing() -> None:
    found = [
        adapter("weak", max_storage_buffers_per_shader_stage=4),
        adapter("good", features=("subgroup",)),
        adapter("other", kind="IntegratedGPU"),
        adapter("llvmpipe", kind="CPU"),
    ]
    lines = device_lines(found, threads=8)
    assert "not usable: max-storage-buffers-per-shader-stage 4 (expected 8)" in lines_about("weak", lines)
    good = lines_about("good", lines)
    assert "used by engine auto" in good
    assert "features: subgroup; not shader-f16, shader-float32-atomic, timestamp-query" in good
    assert "buffers of 2,000 MB, bindings of 1,000 MB, 8 storage buffers per stage, 16,384 bytes" in good
    assert "used by engine webgpu with --gpu" in lines_about("other", lines)
    assert "not by auto" in lines_about("llvmpipe", lines)
    assert lines[-1] == "CPU engine: 8 threads"


@pytest.mark.parametrize("found", [[], [adapter("llvmpipe", kind="CPU")]])
def test_without_a_gpu_auto_takes_the_cpu(found: list[Adapter]) -> None:
    lines = device_lines(found, threads=1)
    assert lines[-1] == "CPU engine: 1 thread; used by engine auto"
    assert (lines[0] == NO_ADAPTER) == (not found)
