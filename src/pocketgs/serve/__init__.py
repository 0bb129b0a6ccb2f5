"""`pocketgs serve`: a page on which phones upload captures, a queue that trains them, and a folder that keeps both."""
