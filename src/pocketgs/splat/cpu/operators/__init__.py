"""The passes of a step as operators of their own, which `pocketgs.torch` puts together."""
