"""File formats of scenes, one a file."""
