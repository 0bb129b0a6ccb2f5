"""Structure from motion with COLMAP: camera poses for photographs or a video without poses.

The modules `colmap` and `triangulation`, and `extraction` and `job` that they share, run in processes of their own and
must not import the rest, so nothing is imported here.
"""
