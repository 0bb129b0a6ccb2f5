"""Merging of candidates on a GPU: WGSL passes and their host."""
