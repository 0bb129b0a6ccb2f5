"""Features on the CPU: OpenCV's SIFT, matched by a Numba kernel."""
