"""Differentiable splatting: the `Engine` interface, the reference implementation, and the engines."""
