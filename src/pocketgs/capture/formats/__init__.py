"""Readers of captures: one file per format, and what several of them share."""
