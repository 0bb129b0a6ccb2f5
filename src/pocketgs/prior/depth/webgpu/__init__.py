"""The plane sweep as WebGPU passes.

`passes.py` describes them as data; `shaders/` holds one file per pass.
"""
