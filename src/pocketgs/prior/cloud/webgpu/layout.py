"""Numbers of merging that shaders and host share, and the memory that it takes."""

from __future__ import annotations

ATTRIBUTES = 7
"""Words of a candidate besides its position: colour, direction, confidence."""

MERGED_WORDS = 11
"""Of a voxel: mean position, colour and direction, the sum of confidences, and the number of candidates."""
