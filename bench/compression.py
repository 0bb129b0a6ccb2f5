"""Ways to make a trained scene small: size, quality on photographs that took no part, and seconds.

    python bench/compression.py RESULT_FOLDER CAPTURE
    python bench/compression.py RESULT_FOLDER CAPTURE --ways prune round compress --images images_8

Each way starts from the same scene. Pruning alone keeps as many Gaussians as `compress` does, or `--gaussians`, trains
them for as many steps as a candidate of `compress`, and writes a .ply; rounding alone keeps all Gaussians. What is
distilled is drawn without sorting, as a .ply and as a .pgs. `over` is for comparison with it: the sorted scene, reduced
to the same degree of harmonics and trained for as many steps.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from itertools import takewhile
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Literal, get_args

import tyro
from rich.console import Console
from rich.table import Table

from pocketgs.capture.capture import Capture
from pocketgs.capture.options import CaptureOptions
from pocketgs.cli.capture_options import read_capture
from pocketgs.cli.scene_file import as_trained_on, load_scene
from pocketgs.compression.candidates import PRUNING_STEPS, ROUNDING_STEPS, STEPS
from pocketgs.compression.compress import compress
from pocketgs.compression.figures import Figures, quality_on
from pocketgs.compression.fine_tuning import FineTuner
from pocketgs.compression.options import CompressionOptions
from pocketgs.compression.pruning import Pruner
from pocketgs.compression.rounding import rounded_in_turn
from pocketgs.compression.spz_file import as_spz
from pocketgs.compression.views import photographed
from pocketgs.results.folder import write_json
from pocketgs.scene.edits import drawable, with_sh_degree
from pocketgs.scene.formats.pgs import decode, encode
from pocketgs.scene.formats.pgs_coding import DEFAULT
from pocketgs.scene.gaussians import Gaussians
from pocketgs.sort_free.distil import DistilOptions, distil
from pocketgs.sort_free.drawing import drawing_of
from pocketgs.sort_free.file import read_sort_free, write_sort_free
from pocketgs.splat.choose_engine import chosen_engine, create_engine
from pocketgs.splat.engine import EngineOptions, Renderer
from pocketgs.splat.rasterizer import Rasterizer

Way = Literal[
    ".ply",
    ".spz",
    ".sog",
    "compress",
    "masks",
    "prune",
    "round",
    "over",
    "visibility",
    "lc",
    "mobile",
    "degree 0",
    "photographs alone",
]
WAYS: tuple[Way, ...] = get_args(Way)


@dataclass(frozen=True)
class Made:
    """A scene as a file holds it, with a renderer that draws it."""

    name: str
    gaussians: int
    bytes: int
    renderer: Renderer


def main(
    scene: Annotated[Path, tyro.conf.Positional],
    capture: Annotated[Path, tyro.conf.Positional],
    *,
    ways: tuple[Way, ...] = WAYS,
    gaussians: int | None = None,
    iterations: int = 500,
    json: Path | None = None,
    engine: EngineOptions = EngineOptions(),  # noqa: B008 - a frozen dataclass
    reading: CaptureOptions = CaptureOptions(),  # noqa: B008 - a frozen dataclass
) -> None:
    """Print the table.

    Args:
        scene: A scene file or a result folder.
        capture: That it was trained on.
        ways: What to compare. "masks" is `compress --prune masks`; "degree 0" and "photographs alone" are "visibility"
            with colours that do not depend on the direction, and without the sorted scene's images and depths.
        gaussians: Number that pruning alone keeps; by default that of `compress`, or a quarter.
        iterations: Steps of distilling, and of "over".
        json: File for the figures.
        engine: Options of the engine.
        reading: How to read the capture.
    """
    console = Console(width=150)
    comparison = Comparison(
        drawable(load_scene(scene)), as_trained_on(scene, read_capture(capture, reading)), engine, iterations, gaussians
    )
    found: list[dict[str, object]] = []
    table = Table("", "Gaussians", "MB", "smaller by", "PSNR (dB)", "SSIM", "s")
    original: Figures | None = None
    for figures, seconds in comparison.rows(ways):
        original = original or figures
        assert figures.megabytes
        assert original.megabytes
        table.add_row(
            figures.name,
            f"{figures.gaussians:,}",
            f"{figures.megabytes:.3f}",
            f"{original.megabytes / figures.megabytes:.1f}",
            f"{figures.psnr:.2f}",
            f"{figures.ssim:.4f}",
            f"{seconds:.0f}",
        )
        found.append({**asdict(figures), "seconds": seconds})
        if json:
            write_json(json, {"figures": found})
    console.print(table)
    console.print(f"on {len(comparison.views.reported)} held-out photographs that took no part in decisions")


class Comparison:
    """Makes the scene small in different ways.

    Args:
        scene: the original.
        capture: that it was trained on.
        engine: options of the engine.
        iterations: of distilling.
        gaussians: that pruning alone keeps, or None for as many as the first `compress`, or a quarter.
    """

    def __init__(
        self, scene: Gaussians, capture: Capture, engine: EngineOptions, iterations: int, gaussians: int | None
    ) -> None:
        self.views = photographed(capture)
        self._scene, self._capture, self._iterations = scene, capture, iterations
        self._options, self._engine = engine, create_engine(engine)
        self._rasterizer = Rasterizer(chosen_engine(engine), engine.threads, engine.gpu)
        self._kept = gaussians

    def rows(self, ways: tuple[Way, ...]) -> Iterator[tuple[Figures, float]]:
        """Figures, and the seconds that making each scene took."""
        for way in ways:
            started = time.perf_counter()
            with TemporaryDirectory() as folder:
                for made in self._makers()[way](Path(folder) / "scene"):
                    seconds = time.perf_counter() - started
                    psnr, ssim = quality_on(self.views.reported, made.renderer, self.views.background)
                    yield Figures(made.name, made.gaussians, made.bytes / 1e6, psnr, ssim), seconds
                    started = time.perf_counter()

    def _makers(self) -> dict[Way, Callable[[Path], Iterator[Made]]]:
        device = self._options
        plain = DistilOptions(
            "visibility", self._iterations, engine=device.engine, threads=device.threads, gpu=device.gpu
        )
        alone = replace(plain, teacher_weight=0.0, depth_weight=0.0)
        return {
            ".ply": lambda path: self._file(".ply", self._scene, path.with_suffix(".ply")),
            ".spz": lambda path: self._spz(),
            ".sog": lambda path: self._file(".sog", self._scene, path.with_suffix(".sog")),
            "compress": lambda path: self._compressed("compress", CompressionOptions()),
            "masks": lambda path: self._compressed("compress --prune masks", CompressionOptions(prune="masks")),
            "prune": lambda path: self._file("pruning alone, .ply", self._pruned(), path.with_suffix(".ply")),
            "round": lambda path: self._rounded(),
            "over": lambda path: self._file("over, degree 1, .ply", self._sorted(), path.with_suffix(".ply")),
            "visibility": lambda path: self._distilled("visibility", plain, path),
            "lc": lambda path: self._distilled("lc", replace(plain, compositor="lc"), path),
            "mobile": lambda path: self._distilled("mobile", replace(plain, compositor="mobile"), path),
            "degree 0": lambda path: self._distilled("visibility, degree 0", replace(plain, sh_degree=0), path),
            "photographs alone": lambda path: self._distilled("visibility, photographs alone", alone, path),
        }

    def _shown(self, name: str, scene: Gaussians, size: int) -> Made:
        self._engine.upload(scene)
        return Made(name, len(scene), size, self._engine)

    def _file(self, name: str, scene: Gaussians, path: Path) -> Iterator[Made]:
        scene.save(path)
        yield self._shown(name, Gaussians.load(path), path.stat().st_size)

    def _spz(self) -> Iterator[Made]:
        found = as_spz(self._scene)
        if found:
            yield self._shown(".spz", found.scene, found.bytes)

    def _compressed(self, name: str, options: CompressionOptions) -> Iterator[Made]:
        found = compress(self._scene, self.views, self._engine, options, rasterizer=self._rasterizer)
        self._kept = self._kept or found.chosen.count
        yield self._shown(name, found.chosen.scene, len(found.chosen.contents))

    def _tuner(self) -> tuple[FineTuner, Pruner]:
        views = self.views
        tuner = FineTuner(self._engine, views.train, views.background, self._scene, seed=0)
        return tuner, Pruner(tuner, [frame.camera for frame in views.train], "contribution", self._rasterizer)

    def _pruned(self) -> Gaussians:
        tuner, pruner = self._tuner()
        kept = self._kept or len(self._scene) // 4
        larger = takewhile(lambda scene: len(scene) >= kept, pruner.rounds(self._scene, PRUNING_STEPS))
        *_, smallest = larger
        return tuner.tune(pruner.down_to(smallest, kept), STEPS)

    def _rounded(self) -> Iterator[Made]:
        tuner, pruner = self._tuner()
        weights = pruner.weights(self._scene)
        contents = encode(rounded_in_turn(self._scene, tuner, DEFAULT, ROUNDING_STEPS, weights), DEFAULT)
        yield self._shown("rounding alone, .pgs", decode(contents), len(contents))

    def _sorted(self) -> Gaussians:
        tuner, _ = self._tuner()
        return tuner.tune(with_sh_degree(self._scene, min(1, self._scene.sh_degree)), self._iterations)

    def _distilled(self, name: str, options: DistilOptions, path: Path) -> Iterator[Made]:
        scene = distil(self._scene, self._capture, options).scene
        for suffix in (".ply", ".pgs"):
            file = path.with_suffix(suffix)
            write_sort_free(file, scene)
            drawing = drawing_of(read_sort_free(file), self._options)
            yield Made(f"{name}, {suffix}", len(scene), file.stat().st_size, drawing)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
