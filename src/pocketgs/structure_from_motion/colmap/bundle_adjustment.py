"""COLMAP's bundle adjustment of a whole model."""

from __future__ import annotations

import pycolmap


def adjust_bundle(
    model: pycolmap.Reconstruction, *, refine_focal_length: bool = True, refine_extra_params: bool = True
) -> None:
    """Refine a model's poses, points and lenses, without their principal points. Errors of points are not updated.

    Args:
        model: changed.
        refine_focal_length: whether focal lengths may change.
        refine_extra_params: whether distortion may change.
    """
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.refine_focal_length = refine_focal_length
    options.refine_extra_params = refine_extra_params
    # With several threads, sums are in any order, and bundle adjustment amplifies the difference.
    options.ceres.solver_options.num_threads = 1
    pycolmap.bundle_adjustment(model, options)
