"""General WebGPU compute: devices, WGSL linking, passes as data and their executor, sorts and scans.

Nothing here is about splats. The `.js` files are the same host for a browser.
"""
