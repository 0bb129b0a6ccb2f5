"""Gaussians and point clouds, their file formats, and edits."""
