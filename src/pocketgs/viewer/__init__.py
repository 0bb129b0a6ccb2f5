"""The page that shows a scene, and the server that brings it to this machine's browser or to a phone."""
