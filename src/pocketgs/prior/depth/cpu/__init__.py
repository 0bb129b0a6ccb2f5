"""The plane sweep on the CPU, in Numba kernels."""
