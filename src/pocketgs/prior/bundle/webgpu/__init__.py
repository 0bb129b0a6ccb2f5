"""Bundle adjustment on a GPU: WGSL passes and their host."""
