"""Camera models for kernels: one file per model, and the dispatch that kernels call."""
