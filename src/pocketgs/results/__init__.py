"""What a run leaves behind, and the run that writes it."""
