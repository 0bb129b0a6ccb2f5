"""Operator T on the CPU: Numba kernels on vectors of 16 pixels, pieces of the work taken by threads as they come.

A training step is project → sort → bin → rasterize → loss → rasterize_backward → project_backward → adam, each in the
file of that name. No kernel adds to memory that another thread adds to, so a step gives the same bits on any number of
threads.
"""
