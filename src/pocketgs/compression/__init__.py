"""Compression: pruning, fine-tuning and rounding of a trained scene, to the smallest file within a bound."""
