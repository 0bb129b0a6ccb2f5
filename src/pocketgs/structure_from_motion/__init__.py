"""Structure from motion: camera poses for photographs or a video without any, found by COLMAP.

The module `colmap` runs in a process of its own and must not import the rest, so nothing is imported here.
"""
