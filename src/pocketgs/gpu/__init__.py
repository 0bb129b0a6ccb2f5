"""Compute shaders on a GPU: devices, linked WGSL, passes as data and what runs them, sorts and running sums.

Nothing here knows what a splat is. The `.js` files are the same host for a browser.
"""
