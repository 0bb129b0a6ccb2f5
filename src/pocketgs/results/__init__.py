"""The run command and the results that it writes."""
