"""Seeding: initial Gaussians from a point cloud, and what their shapes follow from, the points' neighbours."""
