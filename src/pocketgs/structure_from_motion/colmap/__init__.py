"""What calls pycolmap, in child processes: `verify_and_map`, `matching` and `triangulation` each run one kind of job.

Of the rest of the package they import only `geometry/`; `job` says why they must not load Pillow.
"""
