"""Structure from motion with COLMAP: camera poses for photographs or a video without poses.

The modules `colmap` and `triangulation`, with `job` and `world`, run in processes of their own, which must not load
Pillow: see `job`. So they import nothing else from here, and nothing is imported in this file.
"""
