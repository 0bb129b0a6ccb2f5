"""The benchmarks in `bench/` run, on tiny inputs; those that need PyTorch or another trainer are left out."""

from __future__ import annotations

import json
import re
import runpy
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import pytest

from pocketgs.capture.capture import Capture
from pocketgs.compression import candidates
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


@pytest.fixture
def table_of(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[[str, str], str]:
    """A function that runs a benchmark as a program in this process, whose kernels and devices are ready.

    It returns the output. Random scenes that one benchmark takes from another are a quarter of the size.
    """
    monkeypatch.syspath_prepend(str(BENCH))
    monkeypatch.setenv("COLUMNS", "200")
    random_scene = import_module("cpu_step").random_scene
    monkeypatch.setattr("cpu_step.random_scene", lambda count, x, y: random_scene(count // 4, x // 2, y // 2))

    def table(name: str, options: str) -> str:
        path = str(BENCH / f"{name}.py")
        monkeypatch.setattr(sys, "argv", [path, *options.split()])
        runpy.run_path(path, run_name="__main__")
        return capsys.readouterr().out

    return table


def assert_times_in(table: str) -> None:
    """A table has numbers, none of them NaN, and at least one time of its rows is longer than a microsecond."""
    words = [word.strip("()x,%:") for word in table.split()]
    numbers = [float(word) for word in words if re.fullmatch(r"\d+\.\d+", word)]
    assert "nan" not in words
    assert max(numbers, default=0.0) > 0.001, table


@pytest.mark.parametrize("name", ON_THE_CPU)
def test_benchmarks_of_the_cpu_run(name: str, table_of: Callable[[str, str], str]) -> None:
    assert_times_in(table_of(name, ON_THE_CPU[name]))


@pytest.mark.parametrize("name", ON_THE_GPU)
def test_benchmarks_of_the_gpu_run(name: str, adapter: Adapter, table_of: Callable[[str, str], str]) -> None:
    assert_times_in(table_of(name, f"{ON_THE_GPU[name]} --gpu {adapter.name.split()[0]}"))


def test_steps_are_timed_as_the_recipe_takes_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(BENCH))
    recipe = recipe_named("pocketgs")
    settings = import_module("cpu_step").settings_without_motion()
    assert (settings.loss, settings.adam) == (recipe.loss, recipe.adam)
    assert settings.rates == recipe.rates.scaled(0.0)


def test_ways_to_make_a_scene_small(
    small_capture: Capture,
    written_capture: Path,
    tmp_path: Path,
    table_of: Callable[[str, str], str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With a twentieth of the steps of fine-tuning."""
    for name in ("PRUNING_STEPS", "ROUNDING_STEPS", "STEPS"):
        monkeypatch.setattr(candidates, name, getattr(candidates, name) // 20)
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
