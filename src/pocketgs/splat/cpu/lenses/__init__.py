"""Camera models in kernels: one file per kind of lens, and what kernels ask of any of them."""
