"""Operator T in float64 NumPy: short, readable, slow. The executable specification that the engines are held to.

A training step is project → rasterize → loss → rasterize_backward → project_backward → adam.
"""
