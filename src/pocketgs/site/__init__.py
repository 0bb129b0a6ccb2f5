"""A static site that trains captures in the browser, and the command's part that writes it."""
