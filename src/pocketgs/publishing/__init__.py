"""Putting results into a folder: one process at a time, all or nothing, and never over somebody else's files."""
