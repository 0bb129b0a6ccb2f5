"""Compile the kernels that most tests need.

Test processes that start side by side without machine code would each compile the same kernels.
"""

from __future__ import annotations

from multiprocessing import Process

from pocketgs.capture.synthetic import demo_capture
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.system.compile import is_compiled
from pocketgs.training.options import TrainingOptions
from pocketgs.training.planning.machine import ENGINE_KERNELS, FEATURE_KERNELS, PRIOR_KERNELS, SWEEP_KERNELS
from pocketgs.training.preparation import prepare


def compile_engine() -> None:
    """Compile the CPU engine."""
    if not is_compiled(ENGINE_KERNELS):
        CpuEngine().prepare()


def compile_prior() -> None:
    """Compile the prior, and the synthetic captures' ray casting; poses are a phone's, so that they are refined."""
    if not all(map(is_compiled, (*PRIOR_KERNELS, FEATURE_KERNELS, SWEEP_KERNELS))):
        prepare(demo_capture(width=160, height=120, frames=20), TrainingOptions(effort="quick", engine="cpu"))


def main() -> None:
    """Compile in two processes, which take about as long as each other."""
    processes = [Process(target=target) for target in (compile_engine, compile_prior)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    if any(process.exitcode for process in processes):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
