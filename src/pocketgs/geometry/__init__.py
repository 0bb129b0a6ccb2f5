"""Cameras and rotations, and what a set of cameras says about a scene."""
