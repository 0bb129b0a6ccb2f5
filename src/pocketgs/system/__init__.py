"""Process-level services: signals, cores, kernel compilation, timing and memory."""
