"""Nearest neighbours on a GPU: WGSL passes and their host."""
