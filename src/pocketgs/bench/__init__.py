"""The table of results: named methods on named captures, run as commands that anyone can type, and a report of it."""
