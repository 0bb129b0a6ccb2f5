"""The web viewer: a page that shows a scene, and its server."""
