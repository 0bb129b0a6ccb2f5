"""The small scenes and views of the engines' tests."""

from splat.conftest import camera, make_gaussians

__all__ = ["camera", "make_gaussians"]
