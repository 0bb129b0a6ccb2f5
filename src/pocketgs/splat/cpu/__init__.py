"""Operator T on the CPU: Numba kernels on vectors of 16 pixels, with dynamic scheduling.

A training step is project → sort → bin → rasterize → loss → rasterize_backward → project_backward → adam, each in the
file of that name. No two threads accumulate into the same memory, so a step gives the same bits on any number of
threads.
"""
