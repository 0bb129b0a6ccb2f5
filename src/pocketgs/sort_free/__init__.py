"""Images without sorting: weights of Gaussians before a sum, and a division by pixel after it."""
