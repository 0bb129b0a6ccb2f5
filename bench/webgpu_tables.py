"""Measurements of the WebGPU engine, and their tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from rich.table import Table

from pocketgs.gpu.timing import PassTimes
from pocketgs.splat.engine import EngineOptions
from webgpu_roofline import Roofline
from webgpu_work import Work

PAIR_PASSES = ("rasterize", "rasterize backward")

LISTED = 0.005
"""Buffers below this share of the memory are listed together."""

CHOICES: dict[str, tuple[str, str]] = {
    "precision": ("f32", "f16"),
    "replay": ("recompute", "cache"),
    "accumulation": ("ordered", "atomic"),
}
"""Options with two values; the first is the baseline of comparisons."""


@dataclass(frozen=True)
class Measurement:
    """Measurements of one engine on one scene.

    Attributes:
        options: of the engine.
        passes: times of steps with timed passes.
        step: milliseconds per step as submitted in training.
        memory: bytes on the GPU, by buffer.
        work: of the steps.
    """

    options: EngineOptions
    passes: PassTimes
    step: float
    memory: dict[str, int]
    work: Work

    @property
    def milliseconds(self) -> dict[str, float]:
        """Median milliseconds by pass."""
        return self.passes.medians()

    def pairs_per_second(self, name: str) -> float:
        """Pairs per second of one of PAIR_PASSES."""
        pairs = self.work.forward_pairs if name == "rasterize" else self.work.backward_pairs
        return 1e3 * pairs / self.milliseconds[name]


def _name(options: EngineOptions) -> str:
    return ", ".join(getattr(options, choice) for choice in CHOICES)


def passes_table(measurement: Measurement, roofline: Roofline) -> Table:
    """Time by pass, and the minimum share of the device's bandwidth that it uses."""
    table = Table("pass", "ms", "share", "MB at least", "GB/s", "of a copy", title=_name(measurement.options))
    moved = measurement.work.bytes_moved(measurement.passes.symbols, measurement.options)
    milliseconds = measurement.milliseconds
    for name, duration in milliseconds.items():
        row = [name, f"{duration:.3f}", f"{duration / sum(milliseconds.values()):.1%}"]
        if name in moved and duration > 0.0:
            rate = 1e3 * moved[name] / duration
            row += [f"{moved[name] / 1e6:.2f}", f"{rate / 1e9:.1f}", f"{rate / roofline.bytes_per_second:.0%}"]
        table.add_row(*row)
    return table


def steps_table(measurements: Sequence[Measurement]) -> Table:
    """Whole steps, as submitted in training."""
    table = Table("engine", "step (ms)", "steps/s", "passes alone (ms)", "GPU MB")
    for one in measurements:
        table.add_row(
            _name(one.options),
            f"{one.step:.3f}",
            f"{1e3 / one.step:.1f}",
            f"{sum(one.milliseconds.values()):.3f}",
            f"{sum(one.memory.values()) / 1e6:.1f}",
        )
    return table


def pairs_table(measurements: Sequence[Measurement], roofline: Roofline) -> Table:
    """The two passes over splat-pixel pairs."""
    table = Table("engine", "pass", "visited (M)", "contribute", "G pairs/s", "GFLOP/s", "of FMA")
    for one in measurements:
        flops = one.work.flops(one.options)
        for name in PAIR_PASSES:
            rate, seconds = one.pairs_per_second(name), one.milliseconds[name] / 1e3
            visited = rate * seconds
            table.add_row(
                _name(one.options),
                name,
                f"{visited / 1e6:.2f}",
                f"{one.work.contributing_pairs / visited:.0%}",
                f"{rate / 1e9:.2f}",
                f"{flops[name] / seconds / 1e9:,.1f}",
                f"{flops[name] / seconds / roofline.flops_per_second:.1%}",
            )
    return table


def ratios_table(measurements: Sequence[Measurement]) -> Table:
    """Ratios of time and memory between the two values of each option, all else equal."""
    table = Table("ratio", "all else", "step", *PAIR_PASSES, "GPU memory")
    of = {one.options: one for one in measurements}
    for choice, (plain, other) in CHOICES.items():
        for one in measurements:
            changed: dict[str, Any] = {choice: plain}
            compared = of.get(replace(one.options, **changed))
            if getattr(one.options, choice) == plain or compared is None:
                continue
            times = [one.milliseconds[name] / compared.milliseconds[name] for name in PAIR_PASSES]
            memory = sum(one.memory.values()) / sum(compared.memory.values())
            rest = ", ".join(getattr(one.options, name) for name in CHOICES if name != choice)
            ratios = [one.step / compared.step, *times, memory]
            table.add_row(f"{other} / {plain}", rest, *(f"{ratio:.2f}" for ratio in ratios))
    return table


def memory_table(measurements: Sequence[Measurement]) -> Table:
    """Megabytes on the GPU by buffer, the largest first."""
    table = Table("buffer (MB)", *(_name(one.options) for one in measurements))
    most = max(sum(one.memory.values()) for one in measurements)
    largest = {name: max(one.memory[name] for one in measurements) for name in measurements[0].memory}
    listed = sorted((name for name in largest if largest[name] >= LISTED * most), key=lambda name: -largest[name])
    for name in listed:
        table.add_row(name, *(f"{one.memory[name] / 1e6:.2f}" for one in measurements))
    others = [sum(size for name, size in one.memory.items() if name not in listed) for one in measurements]
    table.add_row(f"the other {len(largest) - len(listed)}", *(f"{size / 1e6:.2f}" for size in others))
    table.add_section()
    table.add_row("in total", *(f"{sum(one.memory.values()) / 1e6:.1f}" for one in measurements))
    return table
