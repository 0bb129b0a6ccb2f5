"""The benchmark: named methods on named captures, run as ordinary commands, with tables and a report."""
