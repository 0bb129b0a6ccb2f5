"""Made-up results of a benchmark."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from pocketgs.benchmark.results import Cell, CellResult

MakeResult = Callable[..., CellResult]


@pytest.fixture(scope="session")
def made_result() -> MakeResult:
    """A function that makes a result; keyword arguments replace entries of its run."""

    def make(capture: str = "fern", method: str = "pocketgs", seed: int = 0, **run: Any) -> CellResult:
        command = f"pocketgs train {capture} --method {method} --seed {seed}"
        machine = {"processor": "Abacus 9", "cores": "2"}
        cell = Cell(capture, method, seed)
        return CellResult(cell, command, None, 30.0, {"ply": 5_200_000}, _run() | run, machine=machine)

    return make


@pytest.fixture(scope="session")
def failed_result() -> MakeResult:
    """A function that makes the result of a run that failed."""

    def make(capture: str, method: str, seed: int, error: str) -> CellResult:
        return CellResult(Cell(capture, method, seed), "pocketgs train", error)

    return make


@pytest.fixture(scope="session")
def many_results(made_result: MakeResult, failed_result: MakeResult) -> list[CellResult]:
    """Two captures, three methods, two seeds; one of the runs failed and one was never made."""
    results = []
    for capture in ("fern", "fox"):
        for place, method in enumerate(("pocketgs", "3dgs-sfm", "no-seeding")):
            for seed in (0, 1):
                psnr = 28.0 - place + 0.5 * seed
                result = made_result(capture, method, seed, psnr=psnr, progress=_progress(psnr))
                results.append(replace(result, wall_seconds=30.0 + 5 * place))
    results[-1] = failed_result("fox", "no-seeding", 1, "it ran\nout of paper")
    return [it for it in results if it.cell != Cell("fern", "3dgs-sfm", 1)]


@pytest.fixture
def leave_pictures(tmp_path: Path) -> Callable[[CellResult, Mapping[str, np.ndarray]], Path]:
    """A function that writes images (H, 2 W, 3) by view and run.json like a run, and returns the parent folder."""

    def leave(result: CellResult, pairs: Mapping[str, np.ndarray]) -> Path:
        folder = tmp_path / "work" / result.cell.name / "held_out"
        folder.mkdir(parents=True)
        for view, pair in pairs.items():
            Image.fromarray(pair).save(folder / f"{view}.png")
        (folder.parent / "run.json").write_text(json.dumps({"psnr": result.run["psnr"]}))
        return tmp_path / "work"

    return leave


def _run() -> dict[str, Any]:
    return {
        "psnr": 28.0,
        "ssim": 0.9,
        "cc_psnr": 28.5,
        "flip": 0.08,
        "lpips": None,
        "lpips_note": "no LPIPS here",
        "gaussians": 50_000,
        "iterations": 500,
        "interrupted": False,
        "peak_rss_mb": 480.0,
        "seconds": {"startup": 1.0, "capture": 0.5, "depth": 4.0, "training": 15.0, "evaluation": 2.0, "total": 22.5},
        "protocol": "498x372, every 8th held out",
        "engine": "cpu",
        "device": "CPU, 2 threads",
        "engine_bytes": {"scene": 4_000_000, "moments": 8_000_000},
        "capture": {"training_views": 17, "held_out_views": 3},
        "images": [{"name": "images/a.png", "psnr": 27.5}, {"name": "images/b.png", "psnr": 28.5}],
        "progress": _progress(28.0),
        "memory": [{"seconds": 0.5 * it, "stage": "depth", "rss_mb": 200.0 + 10 * (it % 7)} for it in range(60)],
        "versions": {"python": "3.11", "pocketgs": "0.1.0"},
    }


def _progress(psnr: float) -> list[dict[str, float]]:
    return [
        {"iteration": 100 * it, "elapsed": 5.0 + 3 * it, "loss": 0.05, "held_out_psnr": psnr - 5 + it}
        for it in range(1, 6)
    ]
