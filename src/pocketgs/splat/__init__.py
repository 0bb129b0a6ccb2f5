"""Operator T: differentiable splatting. What an engine is, the readable reference, and the engines."""
