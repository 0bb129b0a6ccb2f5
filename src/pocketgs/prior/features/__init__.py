"""Features, their matches between views, and the tracks that matches make."""
