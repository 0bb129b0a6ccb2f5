"""Operator T in WebGPU compute shaders: all state lives on the GPU, and a step is a fixed list of passes.

The passes stand in `shaders/`, a file each, named as in the reference; what several share is in `shaders/common/`.
`passes.py` puts them in order, as data that any host with WebGPU can replay; `replay.py` is this package's.
"""
