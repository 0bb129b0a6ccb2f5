"""The figures that the source reports for its methods.

*PocketGS: On-Device Training of 3D Gaussian Splatting for High Perceptual Modeling* (Guo et al., 2026), the comparison
with 3DGS on three datasets and the ablations on MobileScan. They are means over all scenes of a dataset after 500
iterations, on other machines than ours: the 3DGS methods on a workstation ("WK"), PocketGS on an iPhone 15.
"""

from __future__ import annotations

from dataclasses import dataclass

SOURCE = "Guo et al., 2026"

ITERATIONS = 500


@dataclass(frozen=True)
class Published:
    """The figures that the source reports for a method on a dataset.

    Attributes:
        method: its name there; `pocketgs.benchmark.methods.Method.stands_for` refers to it.
        psnr: in dB, mean over the dataset's scenes.
        ssim: likewise.
        lpips: likewise.
        seconds: of the whole pipeline.
        gaussians: their number, to thousands, or None if the source reports none.
    """

    method: str
    psnr: float
    ssim: float
    lpips: float
    seconds: float
    gaussians: int | None = None


LLFF, NERF_SYNTHETIC, MOBILE_SCAN = "LLFF", "NeRF-Synthetic", "MobileScan"

FULL, FROM_SPARSE, FROM_DENSE = "PocketGS", "3DGS-SFM-WK", "3DGS-MVS-WK"

COMPARISON: dict[str, tuple[Published, ...]] = {
    LLFF: (
        Published(FROM_SPARSE, 21.01, 0.641, 0.405, 108.0, 18_000),
        Published(FROM_DENSE, 19.53, 0.637, 0.387, 313.1, 40_000),
        Published(FULL, 23.54, 0.791, 0.222, 105.4, 33_000),
    ),
    NERF_SYNTHETIC: (
        Published(FROM_SPARSE, 21.75, 0.800, 0.243, 83.7, 12_000),
        Published(FROM_DENSE, 24.47, 0.887, 0.128, 532.1, 50_000),
        Published(FULL, 24.32, 0.858, 0.144, 101.4, 47_000),
    ),
    MOBILE_SCAN: (
        Published(FROM_SPARSE, 21.16, 0.687, 0.398, 112.8, 23_000),
        Published(FROM_DENSE, 20.85, 0.781, 0.281, 534.5, 165_000),
        Published(FULL, 23.67, 0.791, 0.225, 255.2, 168_000),
    ),
}

ABLATIONS: tuple[Published, ...] = (
    Published("w/o I", 22.49, 0.770, 0.253, 319.5),
    Published("w/o Global BA", 23.45, 0.752, 0.232, 251.1),
    Published("w/o MVS", 21.07, 0.646, 0.414, 124.8),
)
"""On MobileScan: without the discs, the bundle adjustment, and the dense cloud."""

DATASETS = {"fern": LLFF, "lego": NERF_SYNTHETIC, "fox": MOBILE_SCAN, "demo": MOBILE_SCAN}
"""The dataset that each capture is compared with, by the capture's name."""

_BELONGS = {LLFF: "is one of its scenes", NERF_SYNTHETIC: "is one of its scenes"}


def reported(method: str, dataset: str) -> Published | None:
    """The figures that the source reports for a method, by its name there, on a dataset; None if there are none."""
    rows = COMPARISON.get(dataset, ()) + (ABLATIONS if dataset == MOBILE_SCAN else ())
    return next((row for row in rows if row.method == method), None)


def comparability(capture: str) -> str | None:
    """State how far a capture's figures compare with the source's; None if the source reports nothing similar."""
    dataset = DATASETS.get(capture)
    if dataset is None:
        return None
    belongs = _BELONGS.get(dataset, "is not part of it, and comparable in kind, not in value")
    return (
        f"Source: {SOURCE}, means over the scenes of {dataset} after {ITERATIONS} iterations, 3DGS on a workstation "
        f"and PocketGS on an iPhone 15; {capture} {belongs}. Times are of those machines."
    )
