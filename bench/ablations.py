"""What each part of the method is worth on a capture: quality on held-out views with parts left out, one at a time.

    python bench/ablations.py                            # the built-in demo
    python bench/ablations.py ../data/fox --downscale 4

Every row is trained on the same photographs for the same number of iterations with the same recipe.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table

from pocketgs.capture import Capture, Frame
from pocketgs.capture.synthetic import read_ground_truth, write_demo
from pocketgs.cli.capture_options import CaptureOptions
from pocketgs.preparation import prepare
from pocketgs.run import evaluate_held_out
from pocketgs.splat.engine import create_engine
from pocketgs.training import train
from pocketgs.training_options import TrainingOptions

VARIANTS: dict[str, dict[str, object]] = {
    "pocketgs": {},
    "without seeding: balls": {"seeds": "balls"},
    "without bundle adjustment": {"bundle": False},
    "without the dense cloud": {"prior": "sparse"},
    "without evening out exposure": {"exposure": "off"},
    "one reference a keyframe": {"references": 1},
    "twice the keyframes": {"max_keyframes": 30},
}


def main(
    capture: Annotated[Path | None, tyro.conf.Positional] = None,
    demo_folder: Path = Path("output/demo-capture"),
    training: TrainingOptions = TrainingOptions(evaluate_every=0),  # noqa: B008 - a frozen dataclass
    reading: CaptureOptions = CaptureOptions(),  # noqa: B008
) -> None:
    """Print the table.

    Args:
        capture: A capture's folder; the built-in demo if none is named.
        demo_folder: Where the built-in demo is kept.
        training: How to train.
        reading: How to read the capture.
    """
    if capture is None:
        write_demo(demo_folder)
    opened = reading.open(capture or demo_folder)
    rows = [(name, opened, replace(training, **changes)) for name, changes in VARIANTS.items()]  # type: ignore[arg-type]
    if capture is None:
        rows.append(("with the true poses", with_true_poses(opened, demo_folder), training))
    table = Table("variant", "PSNR (dB)", "", "SSIM", "Gaussians", "prior (s)", "training (s)", title=opened.protocol)
    whole: float | None = None
    for name, photographs, options in rows:
        psnr, cells = measured(photographs, options)
        whole = psnr if whole is None else whole
        table.add_row(name, f"{psnr:.2f}", f"{psnr - whole:+.2f}", *cells)
    Console(width=120).print(table)


def measured(capture: Capture, options: TrainingOptions) -> tuple[float, list[str]]:
    """PSNR of a run, and the cells of the table that follow it."""
    started = time.perf_counter()
    prepared = prepare(capture, options)
    seconds = time.perf_counter() - started
    scene = train(capture, options, prepared=prepared)
    engine = create_engine(options.engine_options)
    engine.upload(scene)
    evaluation = evaluate_held_out(engine, prepared.capture)
    assert evaluation is not None
    assert scene.record is not None
    training = scene.record.seconds["training"]
    return evaluation.psnr, [f"{evaluation.ssim:.4f}", f"{len(scene):,}", f"{seconds:.1f}", f"{training:.1f}"]


def with_true_poses(capture: Capture, folder: Path) -> Capture:
    """The demo with the poses that its phone truly had."""
    true = read_ground_truth(folder).cameras

    def posed(frames: list[Frame]) -> list[Frame]:
        return [replace(frame, camera=true[frame.name]) for frame in frames]

    return replace(capture, train=posed(capture.train), held_out=posed(capture.held_out))


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
