"""Variants of the passes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pocketgs.splat.engine import Accumulation, Precision, Replay
from pocketgs.splat.webgpu.lenses import PINHOLE

DrawnShape = Literal["splats", "points", "discs"]
Weights = Literal["direct", "exponential", "lc", "mobile", "visibility"]

COVERAGES: dict[Weights, str] = {
    "direct": "weighted.against_background",
    "exponential": "weighted.against_background",
    "lc": "weighted.against_background",
    "mobile": "weighted.by_transmittance",
    "visibility": "weighted.by_transmittance",
}
"""Rule for the share of the background that shows, by weights: see `common/weighted.wgsl`."""


@dataclass(frozen=True)
class Variant:
    """Variant of the passes.

    Attributes:
        precision: of splats and of the replay cache.
        replay: whether the backward pass recomputes α, "recompute", or reads it from the forward pass's "cache".
        accumulation: how tiles' gradients are summed: "ordered", in rows that are added up later, or "atomic".
        subgroups: whether threads of a subgroup add up without workgroup memory.
        appearance: shape that Gaussians are drawn as; training always draws splats.
        weights: weights of Gaussians without sorting, for rendering only; None to sort.
        lenses: lenses that cameras may have: PINHOLE or LENSES.
    """

    precision: Precision = "f32"
    replay: Replay = "recompute"
    accumulation: Accumulation = "ordered"
    subgroups: bool = False
    appearance: DrawnShape = "splats"
    weights: Weights | None = None
    lenses: tuple[str, ...] = PINHOLE

    @property
    def sections(self) -> dict[str, str]:
        """From the shaders' interfaces to the sections that implement them."""
        cached = self.replay == "cache"
        return {
            "splats.words": f"splats.words_{self.precision}",
            "replay.words": f"replay.words_{self.precision}",
            "replay.source": "replay.from_cache" if cached else "replay.by_recomputing",
            "replay.record": "replay.record_in_cache" if cached else "replay.record_nothing",
            "compositor.forward": "over.forward",
            "compositor.backward": "over.backward",
            "compositor.inspection": "over.inspection",
            "channels.kind": "channels.colour",
            "gradient_rows.add": f"gradient_rows.add_{self.accumulation}",
            "gradient_rows.gather": f"gradient_rows.gather_{self.accumulation}",
            "appearance.kind": f"appearance.{self.appearance}",
            "scan.exclusive": "scan.subgroup" if self.subgroups else "scan.shared",
            "depth_keys.kind": "depth_keys.written",
            "weights.kind": "weights.none",
            "weights.finished": "weights.as_made",
            **self._weighted,
        }

    @property
    def _weighted(self) -> dict[str, str]:
        """The sections of drawing without sorting."""
        if self.weights is None:
            return {}
        assert self.precision == "f32", "weights are stored in full precision"
        return {
            "splats.words": "splats.words_weighted",
            "compositor.forward": "weighted.forward",
            "weighted.coverage": COVERAGES[self.weights],
            "depth_keys.kind": "depth_keys.none",
            "weights.kind": f"weights.{self.weights}",
            "weights.finished": "weights.by_largest" if self.weights == "visibility" else "weights.as_made",
        }

    @property
    def features(self) -> frozenset[str]:
        """Optional features that a device must have."""
        needed = {"subgroup": self.subgroups, "shader-float32-atomic": self.accumulation == "atomic"}
        return frozenset(feature for feature, is_needed in needed.items() if is_needed)
