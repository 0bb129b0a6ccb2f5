"""Depth maps of keyframes by plane sweeps; in Numba kernels in `cpu/`, as WebGPU passes in `webgpu/`."""
