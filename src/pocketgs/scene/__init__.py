"""Gaussians and point clouds as data, their file formats, and edits to them."""
