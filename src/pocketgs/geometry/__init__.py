"""Cameras, lenses, rotations, camera paths, and estimates from sets of cameras."""
