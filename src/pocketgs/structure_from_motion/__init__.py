"""Structure from motion with COLMAP: camera poses for photographs or a video without poses.

The modules in `colmap/` run in processes of their own, which must not load Pillow, and only these load pycolmap: see
`colmap/job.py`. The other modules import only what describes jobs from there, `*_job.py`. Both import this file, so
nothing is imported here.
"""
