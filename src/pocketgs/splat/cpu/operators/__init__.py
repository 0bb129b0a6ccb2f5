"""The passes of a step as separate operators, for `pocketgs.torch`."""
