"""Merging of candidates on the CPU, in NumPy."""
