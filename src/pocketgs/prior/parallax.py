"""Parallax: how far apart two views have to be to tell how far away something is."""

from __future__ import annotations

import numpy as np

LEAST_PARALLAX = float(np.radians(0.2))
"""Minimum angle between the rays of two views to a point, in radians: with less, one view is a copy of the other.

Copies come from bursts, and from videos while the phone stands still. They match at every depth, so they confirm
whatever depth the other one has. At the size of a sweep, this angle is two to three pixels.
"""
