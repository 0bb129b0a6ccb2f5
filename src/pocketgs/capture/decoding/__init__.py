"""Decoding of photographs, masks, depth maps, videos and point clouds."""
