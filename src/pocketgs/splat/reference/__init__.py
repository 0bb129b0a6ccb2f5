"""Operator T in float64 NumPy: short, readable, slow. The executable specification of the engines.

A training step is project → rasterize → loss → rasterize_backward → project_backward → adam.
"""
