"""The quantities that determine a run's memory and time."""

from __future__ import annotations

from dataclasses import dataclass

from pocketgs.capture.outline import Outline
from pocketgs.prior.cloud.fuse import most_candidates
from pocketgs.prior.depth.depth_maps import stereo_extent, sweep_pixels
from pocketgs.prior.depth.stereo import StereoExtent
from pocketgs.prior.depth.sweep import SweepSettings
from pocketgs.splat.parameters import ParameterLayout
from pocketgs.training.options import SizedOptions
from pocketgs.training.recipes import recipe_named


@dataclass(frozen=True)
class Work:
    """A run on a capture at one candidate size.

    Attributes:
        outline: the photographs at this size.
        options: of the run, with this number of Gaussians.
        threads: CPU threads.
    """

    outline: Outline
    options: SizedOptions
    threads: int

    @property
    def seen_by_prior(self) -> Outline:
        """The photographs that the geometry prior looks at: undistorted copies where photographs keep their lenses."""
        return self.outline.copies or self.outline

    @property
    def gaussians(self) -> int:
        """Maximum number of Gaussians."""
        return self.options.max_gaussians

    @property
    def coefficients(self) -> int:
        """Coefficients of spherical harmonics per channel."""
        return (recipe_named(self.options.recipe).degree_for(self.options.sh_degree) + 1) ** 2

    @property
    def columns(self) -> int:
        """Number of parameters per Gaussian."""
        return ParameterLayout(self.coefficients).columns

    @property
    def has_prior(self) -> bool:
        """Whether poses are checked and refined."""
        return self.options.prior != "none"

    @property
    def has_depth(self) -> bool:
        """Whether depth is computed."""
        return self.options.prior == "dense"

    @property
    def keyframes(self) -> int:
        """Maximum number of keyframes."""
        return min(self.options.max_keyframes, len(self.outline.training))

    @property
    def sweep_pixels(self) -> int:
        """Pixels of a swept photograph."""
        return min(self.seen_by_prior.pixels, sweep_pixels(self.keyframes))

    @property
    def stereo_extent(self) -> StereoExtent:
        """What depth maps will ask for."""
        settings = SweepSettings(source_views=self.options.source_views)
        return stereo_extent(self.seen_by_prior.training, self.keyframes, settings)

    @property
    def candidates(self) -> int:
        """Pixels that may become points of the cloud."""
        return most_candidates(self.keyframes * self.sweep_pixels)
