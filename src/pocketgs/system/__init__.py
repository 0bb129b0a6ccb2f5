"""What the program needs of its process: signals, cores, compiled kernels, time and memory."""
