"""Bundle adjustment on the CPU, in Numba kernels."""
