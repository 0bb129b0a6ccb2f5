"""Operator T in WebGPU compute shaders: all state lives on the GPU, and a step is a fixed list of passes.

The passes stand in `shaders/`, one file each, named as in the reference; what several share is in `shaders/common/`.
`passes.py` puts them in order, as data that any host with WebGPU can run; `pocketgs.gpu` is this package's.
"""
