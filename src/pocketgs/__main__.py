"""`python -m pocketgs`."""

from pocketgs.cli import main

main()
