"""The benchmarks in `bench/` run, on tiny inputs; those that need PyTorch or another trainer are left out."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from pocketgs.capture.capture import Capture
from pocketgs.gpu.adapters import Adapter
from pocketgs.prior.prior import PreparedCapture
from pocketgs.training.recipes import recipe_named
from pocketgs.training.train import train

BENCH = Path(__file__).resolve().parents[2] / "bench"

ON_THE_CPU = {
    "cpu_step": "--steps 1",
    "culling": "--gaussians 5000 --width 64 --height 48 --rounds 1",
    "sort_free": "--sizes 2000 --width 64 --height 48 --rounds 1 --frames 3",
}
ON_THE_GPU = {
    "webgpu_bundle": "--cameras 6 --observations 300 --views 3 --repeats 1",
    "webgpu_culling": "--gaussians 3000 --steps 1",
    "webgpu_features": "--width 96 --height 72 --repeats 1",
    "webgpu_merging": "--candidates 400 --points 100 --repeats 1",
    "webgpu_neighbours": "--points 500 --repeats 1",
    "webgpu_step": "--small --steps 1 --iterations 1",
    "webgpu_sweep": "--width 64 --height 48 --hypotheses 16 --repeats 1",
}
LEFT_OUT = {"torch_step", "gsplat_simple_trainer", "gsplat_strategies", "splatfacto"}
OF_A_SCENE = {"compression"}
PARTS_OF_OTHERS = {"medians", "pairs", "webgpu_roofline", "webgpu_tables", "webgpu_work"}


def table_of(name: str, options: str) -> str:
    """The output of a benchmark."""
    command = [sys.executable, str(BENCH / f"{name}.py"), *options.split()]
    run = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, "COLUMNS": "200"})
    assert run.returncode == 0, run.stderr
    return run.stdout


def assert_times_in(table: str) -> None:
    """A table has numbers, none of them NaN, and at least one time of its rows is longer than a microsecond."""
    words = [word.strip("()x,%:") for word in table.split()]
    numbers = [float(word) for word in words if re.fullmatch(r"\d+\.\d+", word)]
    assert "nan" not in words
    assert max(numbers, default=0.0) > 0.001, table


@pytest.mark.parametrize("name", ON_THE_CPU)
def test_benchmarks_of_the_cpu_run(name: str) -> None:
    assert_times_in(table_of(name, ON_THE_CPU[name]))


@pytest.mark.parametrize("name", ON_THE_GPU)
def test_benchmarks_of_the_gpu_run(name: str, adapter: Adapter) -> None:
    assert_times_in(table_of(name, f"{ON_THE_GPU[name]} --gpu {adapter.name.split()[0]}"))


def test_steps_are_timed_as_the_recipe_takes_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(BENCH))
    recipe = recipe_named("pocketgs")
    settings = import_module("cpu_step").settings_without_motion()
    assert (settings.loss, settings.adam) == (recipe.loss, recipe.adam)
    assert settings.rates == recipe.rates.scaled(0.0)


def test_ways_to_make_a_scene_small(small_capture: Capture, written_capture: Path, tmp_path: Path) -> None:
    scene, ways = tmp_path / "scene.ply", (".ply", ".spz", ".sog", "prune", "round", "over", "visibility")
    train(PreparedCapture.of(small_capture, None), iterations=20, engine="cpu", max_gaussians=400).scene.save(scene)
    options = f"--ways {' '.join(ways)} --gaussians 100 --iterations 2 --engine cpu --json {tmp_path / 'figures.json'}"
    assert "PSNR" in table_of("compression", f"{scene} {written_capture} {options}")
    rows = json.loads((tmp_path / "figures.json").read_text())["figures"]
    assert len(rows) == len(ways) + 1, "what is distilled is written as a .ply and as a .pgs"
    assert rows[0]["megabytes"] == pytest.approx(scene.stat().st_size / 1e6)
    assert all(row["megabytes"] < rows[0]["megabytes"] and row["psnr"] > 10.0 for row in rows[1:])
    assert [row["gaussians"] for row in rows if "pruning" in row["name"]] == [100]


def test_every_benchmark_is_known_here() -> None:
    known = {*ON_THE_CPU, *ON_THE_GPU, *OF_A_SCENE, *LEFT_OUT, *PARTS_OF_OTHERS}
    assert {path.stem for path in BENCH.glob("*.py")} == known
